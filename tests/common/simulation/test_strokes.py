"""Strokes go from rest to rest, all the way, with the given mean speed."""

from __future__ import annotations

import numpy as np
import pytest

from motiondlo.simulation.strokes import Stroke, gripper_poses, progress

TAU = np.linspace(0.0, 1.0, 2001)


@pytest.mark.parametrize("cruise", [0.0, 0.3, 0.7])
def test_progress_runs_smoothly_from_0_to_1(cruise: float) -> None:
    share = progress(TAU, cruise)
    speed = np.gradient(share, TAU)
    assert share[0] == 0.0
    assert share[-1] == pytest.approx(1.0)
    assert (np.diff(share) >= 0).all()
    assert speed[[0, -1]] == pytest.approx([0.0, 0.0], abs=1e-4)
    assert np.abs(np.diff(speed)).max() < 0.02


def test_without_a_cruise_it_is_the_minimum_jerk_movement() -> None:
    np.testing.assert_allclose(progress(TAU, 0.0), TAU**3 * (10 - 15 * TAU + 6 * TAU**2), atol=1e-12)


def test_strokes_add_up() -> None:
    strokes = (Stroke(0.1, 0.1, (30.0, 0.0), 0.2), Stroke(0.3, 0.2, (0.0, -40.0), 0.0, cruise=0.4))
    poses = gripper_poses((1.0, 2.0, 0.5), strokes, np.array([0.0, 0.1, 0.25, 0.6]))
    np.testing.assert_allclose(poses, [[1, 2, 0.5], [1, 2, 0.5], [31, 2, 0.7], [31, -38, 0.7]], atol=1e-12)
