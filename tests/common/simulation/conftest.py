"""Scenes for tests: small enough for a second or so."""

from __future__ import annotations

import pytest

from motiondlo.simulation.scene import CableParams, GripperParams, SceneParams, StrokeParams


@pytest.fixture(scope="session")
def short_scene() -> SceneParams:
    """A tube on white paper, moved by 25 mm within 25 ms."""
    return SceneParams(
        board="white_paper",
        speed_mm_s=1000.0,
        rest_before_s=0.06,
        rest_after_s=0.05,
        cables=(CableParams(kind="tube", length_mm=60.0, rgb=(0.03, 0.21, 0.25), shape="straight", gripper=0),),
        grippers=(GripperParams(strokes=(StrokeParams(distance_mm=25.0, turn_deg=0.0),)),),
    )
