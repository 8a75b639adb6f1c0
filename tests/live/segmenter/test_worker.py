"""A backend in a process of its own: loading, time limit, death. The classical backend stands for one with a model."""

from __future__ import annotations

import os
import signal
import threading
import time

import cv2
import numpy as np
import pytest

from motiondlo.frames.classical import ClassicalBackend
from motiondlo.frames.params import FrameParams
from motiondlo_services.segmenter.core import BackoffPolicy, SegmenterCore
from motiondlo_services.segmenter.worker import WorkerBackend, WorkerState

pytestmark = pytest.mark.live
DEADLINE_S = 30.0
POLICY = BackoffPolicy(first_us=1, longest_us=1, degraded_after=3)


@pytest.fixture
def frame():
    frame = np.random.default_rng(3).integers(208, 224, (486, 648, 3)).astype(np.uint8)
    cv2.line(frame, (100, 240), (540, 250), (20, 20, 160), 16)
    return frame


@pytest.fixture
def start():
    backends = []

    def make(pulse=lambda: None, **changes):
        backend = WorkerBackend(FrameParams().model_copy(update={"time_limit_s": 20.0, **changes}), pulse)
        backends.append(backend)
        return backend

    yield make
    for backend in backends:
        backend.stop()


def wait_until_loaded(backend):
    until_s = time.monotonic() + DEADLINE_S
    while backend.poll() is WorkerState.LOADING and time.monotonic() < until_s:
        time.sleep(0.02)
    return backend.state


def test_frames_are_answered_while_the_model_loads_and_then_segmented_as_in_one_process(start, frame):
    backend = start()
    core = SegmenterCore(FrameParams(), backend, policy=POLICY)
    assert core.on_frame(frame, 0, "early").failure == "still_loading"
    assert core.retry_us == -1
    assert wait_until_loaded(backend) is WorkerState.READY
    apart = core.on_frame(frame, 1, "a")
    params = FrameParams()
    together = SegmenterCore(params, ClassicalBackend(params.foreground)).on_frame(frame, 1, "a")
    assert len(apart.instances) == len(together.instances) == 1
    distance = np.abs(apart.instances[0].nodes_rgb - together.instances[0].nodes_rgb)
    assert distance.max() < 0.2


def test_a_hung_worker_is_given_up_in_time_and_a_new_one_takes_over(start, frame):
    pulses = []
    backend = start(pulse=lambda: pulses.append(time.monotonic()), time_limit_s=0.5)
    core = SegmenterCore(FrameParams(), backend, policy=POLICY)
    assert wait_until_loaded(backend) is WorkerState.READY
    hung = backend.pid
    os.kill(hung, signal.SIGSTOP)
    began_s = time.monotonic()
    assert core.on_frame(frame, 0, "a").failure == "timed_out"
    assert 0.4 < time.monotonic() - began_s < 3.0
    assert len(pulses) >= 3, "the daemon's heart beats meanwhile"
    assert "0.5 s" in core.problem
    with pytest.raises(ProcessLookupError):
        os.kill(hung, 0)
    assert core.on_frame(frame, 10, "b").failure == "still_loading"
    assert wait_until_loaded(backend) is WorkerState.READY
    assert backend.restarts == 1
    assert backend.pid != hung


def test_SEGMENTATION_CANCELLED_the_worker_keeps_its_model_and_takes_the_next_frame(start, frame):
    class Canceller:
        backend = None

        def __call__(self):
            if self.backend is not None:
                self.backend.cancel()

    canceller = Canceller()
    backend = start(pulse=canceller)
    core = SegmenterCore(FrameParams(), backend, policy=POLICY)
    assert wait_until_loaded(backend) is WorkerState.READY
    worker = backend.pid
    os.kill(worker, signal.SIGSTOP)
    canceller.backend = backend
    threading.Timer(0.5, os.kill, (worker, signal.SIGCONT)).start()
    assert core.on_frame(frame, 0, "a").failure == "cancelled"
    canceller.backend = None
    assert not core.degraded
    assert core.failures_in_a_row == 0
    assert core.on_frame(frame, 1, "b").failure == ""
    assert (backend.pid, backend.restarts) == (worker, 0)


def test_a_killed_worker_is_a_named_failure_and_comes_back(start, frame):
    backend = start()
    core = SegmenterCore(FrameParams(), backend, policy=POLICY)
    assert wait_until_loaded(backend) is WorkerState.READY
    os.kill(backend.pid, signal.SIGKILL)
    assert core.on_frame(frame, 0, "a").failure == "backend_failed"
    assert "SIGKILL" in core.problem
    assert core.on_frame(frame, 10, "b").failure == "still_loading"
    assert wait_until_loaded(backend) is WorkerState.READY
    assert core.on_frame(frame, 20, "c").failure == ""


def test_a_model_that_cannot_be_loaded_says_why(start, frame):
    backend = start(backend="replay", replay_folder="/does/not/exist")
    core = SegmenterCore(FrameParams(), backend, policy=POLICY)
    assert wait_until_loaded(backend) is WorkerState.STOPPED
    assert core.on_frame(frame, 0, "a").failure == "backend_failed"
    assert "no such folder" in core.problem
    assert core.retry_us > 0
    assert core.on_frame(frame, 10, "b").failure == "still_loading"


def test_a_stop_while_waiting_leaves_no_worker_behind(start, frame):
    class Stopped(BaseException):
        pass

    def pulse():
        if armed:
            raise Stopped

    armed = []
    backend = start(pulse=pulse)
    assert wait_until_loaded(backend) is WorkerState.READY
    worker = backend.pid
    os.kill(worker, signal.SIGSTOP)
    armed.append(True)
    with pytest.raises(Stopped):
        backend.segment(frame, None, "a")
    with pytest.raises(ProcessLookupError):
        os.kill(worker, 0)
