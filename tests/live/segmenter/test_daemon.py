"""The segmenter's daemon with a tiny SAM 3: it answers while the model loads, and outlives a model that hangs."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import psutil
import pytest

from motiondlo.bundled import bundled_recording
from motiondlo.bus.session import Bus, open_bus
from motiondlo.frames.sam3_weights import missing_packages
from motiondlo.messages.frame import FrameMessage
from motiondlo.messages.health import HealthMessage
from motiondlo.messages.segmentation import SegmentationMessage
from motiondlo.topics import FRAME, HEALTH, SEGMENTATION
from motiondlo_services.cell_config import bus_section
from motiondlo_services.replay_cell import write_replay_cell

pytestmark = [
    pytest.mark.live,
    pytest.mark.skipif(
        bool(missing_packages()), reason=f"extra sam3 is not installed: {', '.join(missing_packages())}"
    ),
]
DEADLINE_S = 60.0
IMAGE = np.random.default_rng(4).integers(90, 110, (972, 1296, 3)).astype(np.uint8)


class FrameSource:
    """Stands for frame-capture and fusion: hands out frames, collects segmentations and health."""

    def __init__(self, bus: Bus) -> None:
        self._bus = bus
        self._frames = bus.publisher(FRAME)
        self._segmentations = bus.subscriber(SEGMENTATION)
        self._health = bus.subscriber(HEALTH)
        self._t_us = 0
        self.health: list[tuple[float, HealthMessage]] = []
        """With the time of arrival."""

    def until(self, wanted: Callable[[SegmentationMessage], bool], pause_us: int = 60_000_000) -> SegmentationMessage:
        """Hand out frames, ``pause_us`` of event time apart (a pause after a failure is over), until one is wanted."""
        until_s, next_s = time.monotonic() + DEADLINE_S, 0.0
        while time.monotonic() < until_s:
            if time.monotonic() >= next_s and self._frames.has_readers():
                self._t_us += pause_us
                self._frames.put(FrameMessage(t_us=self._t_us, name="frame_000001.jpg", image=IMAGE))
                next_s = time.monotonic() + 0.2
            self._bus.wait(0.05, self._segmentations, self._health)
            self.health += [(time.monotonic(), message) for message in self._health.drain()]
            for message in self._segmentations.drain():
                if wanted(message):
                    return message
        pytest.fail(f"no such segmentation; health: {self.health[-1:]}")


@pytest.fixture
def config(tmp_path: Path) -> Path:
    """A cell with a tiny SAM 3 that is sure of nothing."""
    import torch
    from transformers import Sam3Model

    from motiondlo.frames.sam3_random import byte_tokenizer, tiny_config

    torch.manual_seed(0)
    Sam3Model(tiny_config()).save_pretrained(tmp_path / "weights")
    byte_tokenizer().save_pretrained(tmp_path / "weights")
    sections = {
        "segmenter": {"backend": "sam3", "time_limit_s": 2.0},
        "segmenter.sam3": {"model": "weights", "device": "cpu"},
    }
    return write_replay_cell(tmp_path / "cell.toml", bundled_recording(), "test", sections)


@pytest.fixture
def source(config: Path) -> Iterator[FrameSource]:
    """On the bus in frame-capture's place."""
    with open_bus(bus_section(config).of_daemon("test", "frame-capture"), "frame-capture") as bus:
        yield FrameSource(bus)


@pytest.fixture
def daemon(config: Path) -> Iterator[psutil.Process]:
    """The real one."""
    command = [sys.executable, "-m", "motiondlo_services.segmenter.daemon", "--config", str(config)]
    with subprocess.Popen(command) as child:
        process = psutil.Process(child.pid)
        yield process
        workers = process.children()
        child.terminate()
        assert child.wait(10.0) == 0
        assert not [worker for worker in workers if worker.is_running() and worker.status() != psutil.STATUS_ZOMBIE]


def test_it_answers_while_the_model_loads_and_outlives_one_that_hangs(
    source: FrameSource, daemon: psutil.Process
) -> None:
    assert source.until(lambda m: bool(m.failure)).failure == "still_loading"
    answer = source.until(lambda m: m.failure != "still_loading")
    assert (answer.failure, answer.backend) == ("nothing_found", "sam3")

    (worker,) = daemon.children()
    os.kill(worker.pid, signal.SIGSTOP)
    began_s = time.monotonic()
    answer = source.until(lambda m: m.failure != "nothing_found")
    ended_s = time.monotonic()
    assert answer.failure == "timed_out"
    assert 1.5 < ended_s - began_s < 10.0
    beats = [at_s for at_s, _ in source.health if began_s < at_s < ended_s]
    assert len(beats) >= 3, "the heart beats while the model hangs"
    assert not psutil.pid_exists(worker.pid)

    assert source.until(lambda m: m.failure not in ("timed_out", "still_loading")).failure == "nothing_found"
    health = source.health[-1][1]
    assert health.info["model_restarts"] == 1
