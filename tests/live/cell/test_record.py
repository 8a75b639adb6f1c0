"""A cell that runs is recorded from outside; the recording is the one that the cell plays."""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from motiondlo.bundled import bundled_recording
from motiondlo.events.reader import read_all
from motiondlo.offline.evaluation import evaluate
from motiondlo.offline.ground_truth import load_ground_truth
from motiondlo.offline.tracks import load_tracks
from motiondlo.recording.layout import open_recording
from motiondlo_services.cell_config import wanted_processes
from motiondlo_services.record_run import record
from motiondlo_services.supervisor import Supervisor

pytestmark = pytest.mark.live


def test_a_cell_is_recorded_as_it_was_played(make_cell: Callable[..., Path], tmp_path: Path) -> None:
    config = make_cell(frame_capture={"publish_all": True})
    supervisor = Supervisor(config, wanted_processes(config))
    deadline_s = time.monotonic() + 100.0

    def stopped(_: float) -> bool:
        supervisor.step(time.monotonic())
        return time.monotonic() > deadline_s

    try:
        done = record(config, tmp_path / "recorded", stopped, tmp_path / "tracks.npz", start_limit_s=90.0)
    finally:
        supervisor.stop()
    assert done.lost_batches == 0
    original, recorded = open_recording(bundled_recording()), open_recording(tmp_path / "recorded")
    (played, triggers), (found, found_triggers) = read_all(original.events_path), read_all(recorded.events_path)
    np.testing.assert_array_equal(found["t"], played["t"])
    np.testing.assert_array_equal(found["x"], played["x"])
    np.testing.assert_array_equal(found_triggers["t"], triggers["t"])
    times_us = {entry.t_us for entry in original.frames}
    assert {entry.t_us for entry in recorded.frames} <= times_us
    assert len(recorded.frames) >= len(times_us) - 1
    np.testing.assert_array_equal(recorded.event_from_rgb(), original.event_from_rgb())
    assert recorded.camera_info.event == original.camera_info.event
    assert done.states > 100
    (verdict,) = evaluate(load_tracks(tmp_path / "tracks.npz"), load_ground_truth(original.ground_truth_path)).moved
    assert verdict.ptc_mm.mean is not None
    assert verdict.ptc_mm.mean < 0.5, "states are in the recording's time"
