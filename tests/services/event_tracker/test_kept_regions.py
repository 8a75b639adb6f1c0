"""Regions changed by command outlive the daemon; the configuration's go on to hold for the rest."""

from __future__ import annotations

from pathlib import Path

import pytest

from motiondlo_services.event_tracker.kept_regions import KeptRegions, state_folder

BELT, RAIL = (0.0, 100.0, 320.0, 150.0), (0.0, 0.0, 10.0, 10.0)


def test_changes_are_there_after_a_restart(tmp_path: Path) -> None:
    first = KeptRegions(tmp_path, "cell1")
    first.change({"rail": RAIL}, {"rail": RAIL, "belt": BELT})
    assert first.kept
    again = KeptRegions(tmp_path, "cell1")
    assert again.applied_to({"rail": RAIL}) == {"rail": RAIL, "belt": BELT}
    assert again.applied_to({"rail": BELT}) == {"rail": BELT, "belt": BELT}, "the configuration holds for the others"
    assert KeptRegions(tmp_path, "cell2").applied_to({}) == {}


def test_a_region_of_the_configuration_that_was_taken_away_stays_away(tmp_path: Path) -> None:
    KeptRegions(tmp_path, "cell1").change({"rail": RAIL}, {})
    assert KeptRegions(tmp_path, "cell1").applied_to({"rail": RAIL}) == {}
    KeptRegions(tmp_path, "cell1").change({"rail": RAIL}, {"rail": RAIL})
    assert KeptRegions(tmp_path, "cell1").applied_to({"rail": RAIL}) == {"rail": RAIL}


@pytest.mark.parametrize(
    "text", ["", "{", "[]", '{"regions": 3}', '{"regions": {"belt": [1, 2]}}', '{"regions": {"belt": "abcd"}}']
)
def test_a_damaged_file_is_said_and_changes_nothing(tmp_path: Path, text: str) -> None:
    (tmp_path / "cell1").mkdir()
    (tmp_path / "cell1" / "regions.json").write_text(text)
    kept = KeptRegions(tmp_path, "cell1")
    assert kept.applied_to({"rail": RAIL}) == {"rail": RAIL}
    assert "regions.json" in kept.problem
    kept.change({}, {"belt": BELT})
    assert kept.kept, "the next command puts it right"


def test_without_a_folder_nothing_is_kept(tmp_path: Path) -> None:
    nowhere = KeptRegions(None, "cell1")
    nowhere.change({}, {"belt": BELT})
    assert not nowhere.kept
    assert not nowhere.problem
    (tmp_path / "file").touch()
    blocked = KeptRegions(tmp_path / "file", "cell1")
    blocked.change({}, {"belt": BELT})
    assert not blocked.kept
    assert blocked.problem


def test_systemd_says_where(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.delenv("STATE_DIRECTORY", raising=False)
    assert state_folder(None) is None
    monkeypatch.setenv("STATE_DIRECTORY", "/var/lib/motiondlo:/var/lib/other")
    assert state_folder(None) == Path("/var/lib/motiondlo")
    assert state_folder(tmp_path) == tmp_path
