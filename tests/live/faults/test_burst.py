"""EVENT_BURST: for a while five times as many events as the cell can follow."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from tests.live.faults.conftest import memory_mib

from motiondlo.bundled import bundled_recording
from motiondlo.events.reader import read_all
from motiondlo.events.types import EVENT_DTYPE, EventArray, SensorGeometry
from motiondlo.events.writer import Evt3Encoder, evt3_header
from motiondlo_services.live_run import LiveRun, play
from motiondlo_services.supervisor import Supervisor

pytestmark = pytest.mark.live

SENSOR = SensorGeometry(1280, 720)
QUIET_US = 100_000
"""Of the bundled recording; nothing moves in it yet."""
AFTER_US = 500_000
BATCH_US = 2000
EVENTS_PER_MS = 150_000
"""150 Mev/s, at real speed: five times what the cell follows (decoding takes a core at 50 to 80)."""
RECOVERY_US = 100_000
LATE_MS = 250.0
"""The state's median latency in the burst: 50 to 80 ms on a busy machine; 400 where decoding kept others from work."""
GROWTH_MIB = 400.0
"""Twelve batches of 5 MB wait at most, and as many each are on their way or being looked at; the burst has 1 GB."""


def burst(t0_us: int, seed: int) -> EventArray:
    """All over the sensor within 1 ms, in runs of neighbours as edges make them."""
    rng = np.random.default_rng(seed)
    runs = EVENTS_PER_MS // 32
    events = np.zeros(runs * 32, EVENT_DTYPE)
    events["t"] = t0_us + np.arange(len(events)) * 1000 // len(events)
    events["x"] = (rng.integers(0, SENSOR.width_px - 32, runs)[:, None] + np.arange(32)).reshape(-1)
    events["y"] = np.repeat(rng.integers(0, SENSOR.height_px, runs), 32)
    events["p"] = np.repeat(rng.integers(0, 2, runs), 32)
    events["t"] = np.repeat(events["t"][::32], 32)
    return events


def write_recording(folder: Path, burst_s: float) -> tuple[Path, int]:
    """A scene at rest with a burst in the middle; the recording, and the burst's end, us."""
    source = bundled_recording()
    manifest = json.loads((source / "manifest.json").read_text(encoding="utf-8"))
    name, t_us = min(manifest.items(), key=lambda item: int(item[1]))
    (folder / "frames").mkdir(parents=True)
    shutil.copy(source / "frames" / name, folder / "frames" / name)
    (folder / "manifest.json").write_text(json.dumps({name: t_us}), encoding="utf-8")
    shutil.copytree(source / "homography", folder / "homography")
    for extra in ("camera_info.json", "background.jpg"):
        if (source / extra).is_file():
            shutil.copy(source / extra, folder / extra)
    events, triggers = read_all(source / "events.raw", SENSOR)
    quiet = events[events["t"] < QUIET_US]
    end_us = QUIET_US + int(burst_s * 1e6)
    encoder = Evt3Encoder(SENSOR)
    pieces = [burst(0, seed) for seed in range(8)]
    with (folder / "events.raw").open("wb") as file:
        file.write(evt3_header(SENSOR))
        file.write(encoder.encode(quiet, triggers[triggers["t"] < QUIET_US]))
        for k, t0_us in enumerate(range(QUIET_US, end_us, 1000)):
            piece = pieces[k % len(pieces)].copy()
            piece["t"] += t0_us
            file.write(encoder.encode(piece))
        for k in range(AFTER_US // QUIET_US):
            rest = quiet.copy()
            rest["t"] += end_us + k * QUIET_US
            file.write(encoder.encode(rest))
    return folder, end_us


def test_EVENT_BURST_costs_events_but_neither_memory_nor_time(
    make_cell: Callable[..., Path], tmp_path: Path, burst_s: float
) -> None:
    recording, end_us = write_recording(tmp_path / "burst", burst_s)
    peak_mib: dict[str, float] = {}
    before_mib: dict[str, float] = {}

    def watch_memory(supervisor: Supervisor, run: LiveRun) -> None:
        if run.states and run.states[-1].t_us < QUIET_US:
            before_mib.update(memory_mib(supervisor))
        elif run.states:
            for name, used in memory_mib(supervisor).items():
                peak_mib[name] = max(peak_mib.get(name, 0.0), used)

    run = play(make_cell(recording, speed=1.0), time_limit_s=110.0, on_step=watch_memory)
    assert run.dropped_batches > 0, "no burst for this machine: raise EVENTS_PER_MS"
    grown = {name: peak - before_mib.get(name, peak) for name, peak in peak_mib.items()}
    assert max(grown.values()) < GROWTH_MIB, grown
    assert any(state.mode == "DEGRADED" for state in run.states if QUIET_US < state.t_us <= end_us + BATCH_US)
    during = [s.t_sent_ns - s.t_ingest_ns for s in run.states if QUIET_US + 50_000 < s.t_us <= end_us]
    assert len(during) >= 4
    assert np.median(during) * 1e-6 < LATE_MS
    before = [state for state in run.states if state.t_us <= QUIET_US]
    after = [state for state in run.states if state.t_us >= end_us + RECOVERY_US]
    assert len(after) > 0.8 * (AFTER_US - RECOVERY_US) / BATCH_US
    assert np.mean([state.mode == "DEGRADED" for state in after]) < 0.2, "a busy machine may lose a batch again"
    assert {tuple(dlo.id for dlo in state.dlos) for state in after} == {(0,)}
    latency_ms = [
        np.median([state.t_sent_ns - state.t_ingest_ns for state in part]) * 1e-6 for part in (before, after[:50])
    ]
    assert latency_ms[1] < 2.0 * latency_ms[0] + 3.0, "no backlog is left"
    assert set(run.restarts.values()) == {0}
