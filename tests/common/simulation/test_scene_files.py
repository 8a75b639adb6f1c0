"""Bundled scenes are sound, and what is wrong with a scene is said."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from motiondlo.errors import ConfigError
from motiondlo.geometry.curve import arc_length
from motiondlo.simulation.boards import BOARD_RGB
from motiondlo.simulation.planning import SEGMENT_MM, make_plan
from motiondlo.simulation.scene_files import bundled_scenes, load_scene

NAMES = sorted(bundled_scenes())


def test_the_documented_scenes_are_bundled() -> None:
    wanted = {
        "single_tube", "single_printed", "single_cord", "thin_wire", "thin_wires", "quad", "two_moving", "drag", "loop",
        "occlusion", "conveyor", "lighting", "stop_and_go", "pull", "fan_2", "fan_4", "fan_8",
    }  # fmt: skip
    assert wanted <= set(NAMES)


@pytest.mark.parametrize("name", NAMES)
def test_a_bundled_scene_can_be_planned(name: str) -> None:
    _, scene = load_scene(name)
    plan = make_plan(name, scene, 3)
    assert plan.board in BOARD_RGB
    for params, cable in zip(scene.cables, plan.cables, strict=True):
        steps = np.linalg.norm(np.diff(cable.chain_mm, axis=0), axis=1)
        assert steps.max() < 1.5 * SEGMENT_MM
        assert cable.chain_mm[:, 2].min() >= params.support_mm + 0.5 * cable.diameter_mm - 1e-9
    for gripper in plan.grippers:
        ends = [stroke.start_s + stroke.duration_s for stroke in gripper.strokes]
        assert max(ends) + scene.rest_after_s == pytest.approx(plan.duration_s, abs=0.1)


def test_the_seed_draws_what_is_open_and_repeats_itself() -> None:
    _, scene = load_scene("single_tube")
    one, again, other = (make_plan("single_tube", scene, seed) for seed in (1, 1, 2))
    np.testing.assert_array_equal(one.cables[0].chain_mm, again.cables[0].chain_mm)
    assert one.cables[0].material == again.cables[0].material
    assert one.cables[0].material != other.cables[0].material
    assert arc_length(one.cables[0].chain_mm[:, :2])[-1] != arc_length(other.cables[0].chain_mm[:, :2])[-1]


def test_the_loop_crosses_itself_and_climbs_over_itself() -> None:
    _, scene = load_scene("loop")
    cable = make_plan("loop", scene, 1).cables[0]
    assert cable.chain_mm[:, 2].max() > 1.4 * cable.diameter_mm


def test_an_unknown_scene_names_those_that_there_are() -> None:
    with pytest.raises(ConfigError, match="neither a bundled scene nor a file") as caught:
        load_scene("no_such_scene")
    assert "single_tube" in caught.value.what_to_do


def test_a_wrong_value_names_file_and_field(tmp_path: Path) -> None:
    path = tmp_path / "mine.toml"
    path.write_text('[[cables]]\nkind = "rope"\n')
    with pytest.raises(ConfigError, match=r"mine\.toml: cables\.0\.kind"):
        load_scene(str(path))


def test_a_cable_in_a_gripper_that_is_not_there(tmp_path: Path) -> None:
    path = tmp_path / "mine.toml"
    path.write_text("[[cables]]\ngripper = 1\n[[grippers]]\n")
    with pytest.raises(ConfigError, match="gripper 1"):
        load_scene(str(path))
