"""Regions by configuration and by command: what is taken, shown and refused."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from motiondlo.bundled import bundled_recording
from motiondlo.errors import ConfigError
from motiondlo.events.buckets import EventBuckets
from motiondlo.events.screening import EventScreening
from motiondlo.events.screening_params import ScreeningParams
from motiondlo.events.types import SensorGeometry
from motiondlo_services.cell_config import check_configuration
from motiondlo_services.doctor.cell import check_cell
from motiondlo_services.doctor.findings import Verdict
from motiondlo_services.event_tracker.regions import RefusedError, running_config, set_region
from motiondlo_services.replay_cell import write_replay_cell

BELT = (0.0, 100.0, 320.0, 150.0)


@pytest.fixture
def screening() -> EventScreening:
    return EventScreening(ScreeningParams(), EventBuckets(SensorGeometry(320, 240)))


def test_a_region_is_set_shown_replaced_and_taken_away(screening: EventScreening) -> None:
    assert json.loads(set_region(screening, {"name": "belt", "corners": BELT})["regions"]) == {"belt": list(BELT)}
    assert screening.masked[120, 10]
    set_region(screening, {"name": "belt", "corners": (0, 0, 10, 10)})
    assert not screening.masked[120, 10]
    shown = running_config(screening, {"profile": "default", "regions": {}})
    assert json.loads(shown["regions"]) == {"belt": [0.0, 0.0, 10.0, 10.0]}
    assert json.loads(shown["profile"]) == "default"
    assert json.loads(set_region(screening, {"name": "belt"})["regions"]) == {}
    assert len(screening.masked) == 0


@pytest.mark.parametrize(
    ("args", "names"),
    [
        ({"corners": BELT}, "name"),
        ({"name": "belt"}, "no region 'belt'"),
        ({"name": "belt", "corners": (1.0, 2.0)}, "four numbers"),
        ({"name": "belt", "corners": ("a", "b", "c", "d")}, "numbers"),
        ({"name": "belt", "corners": (900.0, 0.0, 950.0, 10.0)}, "within the sensor"),
    ],
)
def test_a_wrong_request_is_refused_and_changes_nothing(
    screening: EventScreening, args: dict[str, object], names: str
) -> None:
    with pytest.raises(RefusedError, match=names) as refused:
        set_region(screening, args)
    assert refused.value.what_to_do
    assert screening.regions == {}


def test_a_tracker_without_regions_says_so() -> None:
    with pytest.raises(RefusedError, match="profile"):
        set_region(None, {"name": "belt", "corners": BELT})


def cell_with(folder: Path, regions: str) -> Path:
    path = write_replay_cell(folder / "c.toml", bundled_recording())
    path.write_text(f"{path.read_text()}\n[event_tracker.regions]\n{regions}\n")
    return path


def test_a_wrong_region_in_the_configuration_is_named(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"belt: a rectangle with x0 < x1"):
        check_configuration(cell_with(tmp_path, "belt = [10, 0, 5, 9]"))


@pytest.mark.parametrize(
    ("regions", "verdict", "names"),
    [
        ("belt = [0, 10, 60, 20]", Verdict.OK, "1 left out"),
        ("belt = [5000, 0, 5100, 10]", Verdict.FAILURE, "belt touches no pixel"),
        ("belt = [-10, -10, 5000, 5000]", Verdict.WARNING, "100 %"),
    ],
)
def test_doctor_judges_the_regions(tmp_path: Path, regions: str, verdict: Verdict, names: str) -> None:
    found = [f for f in check_cell(cell_with(tmp_path, regions)) if f.subject == "regions"]
    assert [f.verdict for f in found if names in f.what] == [verdict]


@pytest.mark.parametrize(("folder", "verdict"), [("state", Verdict.OK), ("c.toml", Verdict.FAILURE)])
def test_doctor_says_whether_regions_can_be_kept(tmp_path: Path, folder: str, verdict: Verdict) -> None:
    path = cell_with(tmp_path, "")
    path.write_text(path.read_text().replace("[cell]", f'[cell]\nstate_folder = "{folder}"'))
    assert [f.verdict for f in check_cell(path) if f.subject == "state folder"] == [verdict]
