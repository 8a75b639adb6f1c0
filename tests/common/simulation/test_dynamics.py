"""Cables move as cables: held where they are held, as long as they were, at rest until something moves them."""

from __future__ import annotations

import numpy as np
import pytest

from motiondlo.simulation.dynamics import SAMPLE_S, Motion, simulate_motion
from motiondlo.simulation.plan import Plan
from motiondlo.simulation.planning import make_plan
from motiondlo.simulation.scene import SceneParams
from motiondlo.simulation.scene_files import load_scene

pytest.importorskip("mujoco", reason="needs the extra motiondlo[simulate]")


@pytest.fixture(scope="module")
def moved(short_scene: SceneParams) -> tuple[Plan, Motion]:
    plan = make_plan("short", short_scene, 1)
    return plan, simulate_motion(plan)


def test_the_held_end_goes_where_the_gripper_goes(moved: tuple[Plan, Motion]) -> None:
    plan, motion = moved
    chain, pose = motion.chains_mm[0], motion.grippers[0]
    np.testing.assert_allclose(chain[:, 0, :2] - chain[0, 0, :2], pose[:, :2] - pose[0, :2], atol=0.02)
    assert np.hypot(*(pose[-1, :2] - pose[0, :2])) == pytest.approx(25.0)
    assert motion.gripper(0, plan.grippers[0].strokes[0].start_s)[:2] == pytest.approx(pose[0, :2], abs=0.001)


def test_it_keeps_its_length(moved: tuple[Plan, Motion]) -> None:
    plan, motion = moved
    lengths = np.linalg.norm(np.diff(motion.chains_mm[0], axis=1), axis=2).sum(axis=1)
    np.testing.assert_allclose(lengths, plan.cables[0].length_mm, rtol=0.005)


def test_it_is_at_rest_before_and_lags_behind_in_motion(moved: tuple[Plan, Motion]) -> None:
    plan, motion = moved
    chain = motion.chains_mm[0]
    start = int(plan.grippers[0].strokes[0].start_s / SAMPLE_S)
    speed = np.linalg.norm(np.diff(chain, axis=0), axis=2).max(axis=1) / SAMPLE_S
    assert speed[:start].max() < 1.0
    assert speed.max() > 1000.0
    middle = start + int(0.008 / SAMPLE_S)
    way = np.linalg.norm(chain[middle] - chain[0], axis=1)
    assert way[-1] < way[0]


def test_it_lies_on_the_board(moved: tuple[Plan, Motion]) -> None:
    plan, motion = moved
    radius = 0.5 * plan.cables[0].diameter_mm
    assert motion.chains_mm[0][..., 2].min() > radius - 0.15
    assert motion.chains_mm[0][:, -1, 2].max() < radius + 0.5


def test_a_loose_cord_moves_on_contact_and_not_before() -> None:
    _, scene = load_scene("drag")
    plan = make_plan("drag", scene.model_copy(update={"speed_mm_s": 800.0, "rest_after_s": 0.05}), 2)
    motion = simulate_motion(plan)
    pushed = np.linalg.norm(motion.chains_mm[1] - motion.chains_mm[1][0], axis=2).max(axis=1)
    pusher = np.linalg.norm(motion.chains_mm[0] - motion.chains_mm[0][0], axis=2).max(axis=1)
    assert pushed[pusher < 3.0].max() < 0.2
    assert pushed[-1] > 5.0


def test_the_same_seed_gives_the_same_motion(moved: tuple[Plan, Motion]) -> None:
    plan, motion = moved
    np.testing.assert_array_equal(simulate_motion(plan).chains_mm[0], motion.chains_mm[0])
