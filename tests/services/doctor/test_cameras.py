"""The doctor on a cell with cameras."""

from __future__ import annotations

from pathlib import Path

import pytest

from motiondlo.bundled import bundled_recording
from motiondlo.cli.main import main
from motiondlo_services.doctor.cameras import check_cameras
from motiondlo_services.doctor.findings import Verdict


def verdicts(path: Path, text: str) -> dict[str, tuple[Verdict, str]]:
    path.write_text(text, encoding="utf-8")
    findings = check_cameras(path)
    assert all((finding.verdict == Verdict.OK) == (finding.what_to_do == "") for finding in findings)
    return {finding.subject: (finding.verdict, f"{finding.what} {finding.what_to_do}") for finding in findings}


SIMULATED = (
    '[cameras.event]\ndriver = "simulated"\n[cameras.frame]\ndriver = "simulated"\n'
    f'[cameras.simulated]\nrecording = "{bundled_recording()}"\n'
)


def test_simulated_cameras_are_found(tmp_path: Path) -> None:
    found = verdicts(tmp_path / "c.toml", SIMULATED)
    assert {verdict for verdict, _ in found.values()} == {Verdict.OK}
    assert {"event camera", "RGB camera", "trigger line"} <= set(found)


def test_a_cell_without_any_source_is_told_both_ways_out(tmp_path: Path) -> None:
    verdict, text = verdicts(tmp_path / "c.toml", "")["source"]
    assert verdict == Verdict.FAILURE
    assert "[replay] recording" in text
    assert "[cameras.event] driver" in text


def test_bounds_that_cannot_tell_frames_apart_are_warned_of(tmp_path: Path) -> None:
    text = SIMULATED.replace("[cameras.simulated]", "max_latency_ms = 80.0\n[cameras.simulated]")
    verdict, what = verdicts(tmp_path / "c.toml", text)["trigger line"]
    assert verdict == Verdict.WARNING
    assert "max_latency_ms" in what


@pytest.mark.parametrize(
    ("module", "text", "subject"),
    [
        ("neuromorphic_drivers", '[cameras.event]\ndriver = "neuromorphic"\n', "event camera driver"),
        (
            "harvesters.core",
            SIMULATED.replace('frame]\ndriver = "simulated"', 'frame]\ndriver = "genicam"'),
            "RGB camera driver",
        ),
    ],
)
def test_a_driver_that_is_not_installed_names_the_extra(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    module: str,
    text: str,
    subject: str,
) -> None:
    monkeypatch.setitem(__import__("sys").modules, module, None)
    verdict, what = verdicts(tmp_path / "c.toml", text)[subject]
    assert verdict == Verdict.FAILURE
    assert 'pip install "motiondlo[live]"' in what
    assert main(["run", "--config", str(tmp_path / "c.toml")]) == 1
    assert "motiondlo[live]" in capsys.readouterr().err


def test_run_without_a_source_is_refused_before_anything_starts(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "c.toml").write_text("", encoding="utf-8")
    assert main(["run", "--config", str(tmp_path / "c.toml")]) == 1
    assert "[cameras.event] driver" in capsys.readouterr().err
