"""Pairs of curves from a recording: the homography is refined or left alone, never made worse than allowed."""

from __future__ import annotations

import numpy as np

from motiondlo.bundled import bundled_recording
from motiondlo.calibration.moving_cable import refine_from_cables
from motiondlo.geometry.homography_refinement import RefinementParams
from motiondlo.recording.layout import open_recording


def test_the_bundled_recording_gives_pairs_and_a_bounded_answer() -> None:
    recording = open_recording(bundled_recording())
    outcome = refine_from_cables(recording, RefinementParams(least_pairs=3))
    assert outcome.pairs >= 3
    assert outcome.shift_px <= 3.0
    assert outcome.accepted == (not outcome.reason)
    if not outcome.accepted:
        assert np.array_equal(outcome.event_from_rgb, recording.event_from_rgb())
