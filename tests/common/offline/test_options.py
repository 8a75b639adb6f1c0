from __future__ import annotations

import pytest

from motiondlo.cli.track_arguments import MODES, PROFILES
from motiondlo.errors import ConfigError
from motiondlo.offline.options import TrackMode, overrides_from
from motiondlo.tracking import factory


def test_assignments_go_to_their_sections_and_dots_nest():
    assert overrides_from(["tracker.a=3", "frames.fit.nodes=40", "frames.fit.refine=false", "fusion.b=1.5"]) == {
        "tracker": {"a": 3},
        "fusion": {"b": 1.5},
        "frames": {"fit": {"nodes": 40, "refine": False}},
    }


@pytest.mark.parametrize("text", ["a=3", "tracker=3", "tracker.=3", "gripper.a=3", "tracker..a=1", "tracker.a"])
def test_assignment_that_names_no_parameter(text):
    with pytest.raises(ConfigError, match=r"--set"):
        overrides_from([text])


def test_value_and_section_of_the_same_name():
    with pytest.raises(ConfigError, match="fit"):
        overrides_from(["frames.fit=3", "frames.fit.nodes=40"])


def test_choices_of_the_command_line_are_those_of_the_library():
    assert list(MODES) == [mode.value for mode in TrackMode]
    assert PROFILES == factory.PROFILES
