"""The doctor names what is wrong, and what to do about it."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import numpy as np
import pytest

from motiondlo.bundled import bundled_recording
from motiondlo.cli.main import main
from motiondlo_services.doctor.cell import check_cell
from motiondlo_services.doctor.findings import Verdict
from motiondlo_services.doctor.machine import check_machine
from motiondlo_services.replay_cell import write_replay_cell


@pytest.fixture
def recording(tmp_path: Path) -> Path:
    shutil.copytree(bundled_recording(), tmp_path / "recording")
    return tmp_path / "recording"


def verdicts(path: Path) -> dict[str, Verdict]:
    """The worst verdict per subject."""
    order = [Verdict.OK, Verdict.WARNING, Verdict.FAILURE]
    worst: dict[str, Verdict] = {}
    for finding in check_cell(path):
        before = worst.get(finding.subject, Verdict.OK)
        worst[finding.subject] = max(before, finding.verdict, key=order.index)
        assert (finding.verdict == Verdict.OK) == (finding.what_to_do == ""), finding
    return worst


def test_a_good_cell_has_nothing_to_complain_of(tmp_path: Path, recording: Path) -> None:
    assert set(verdicts(write_replay_cell(tmp_path / "c.toml", recording)).values()) == {Verdict.OK}


def test_the_machine_is_judged_without_failing() -> None:
    findings = check_machine()
    assert {"real-time scheduling", "locked memory", "shared memory"} <= {finding.subject for finding in findings}
    assert all(finding.what for finding in findings)


def test_a_singular_homography_and_missing_frames_are_found(tmp_path: Path, recording: Path) -> None:
    np.save(recording / "homography" / "rgb_to_event_H.npy", np.zeros((3, 3)))
    next((recording / "frames").iterdir()).unlink()
    found = verdicts(write_replay_cell(tmp_path / "c.toml", recording))
    assert found["homography"] == Verdict.FAILURE
    assert found["frames"] == Verdict.WARNING


def test_a_wrong_sensor_size_is_found(tmp_path: Path, recording: Path) -> None:
    path = write_replay_cell(tmp_path / "c.toml", recording, sections={"calibration": {"sensor_width_px": 640}})
    assert verdicts(path)["sensor size"] == Verdict.FAILURE


def test_an_endpoint_beyond_the_host_is_refused(tmp_path: Path, recording: Path) -> None:
    path = write_replay_cell(tmp_path / "c.toml", recording)
    path.write_text(path.read_text() + '[bus.endpoints]\nfusion = "tcp/0.0.0.0:29999"\n', encoding="utf-8")
    assert verdicts(path)["configuration"] == Verdict.FAILURE


def test_the_command_fails_and_says_why(tmp_path: Path, recording: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = write_replay_cell(tmp_path / "c.toml", recording)
    path.write_text(path.read_text() + "[event_ingest]\nbatch_us = 1\n", encoding="utf-8")
    assert main(["doctor", "--config", str(path), "--json", str(tmp_path / "d.json")]) == 1
    document = json.loads((tmp_path / "d.json").read_text())
    assert not document["ok"]
    assert any("batch_us = 1" in finding["what"] for finding in document["findings"])
    assert "batch_us" in capsys.readouterr().out
