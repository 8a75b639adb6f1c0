"""``motiondlo calibrate homography`` as a person uses it."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from motiondlo.cli.main import main
from motiondlo.geometry.homography import warp_points

TRUE = np.array([[1.17, -0.05, -60.0], [0.08, 1.12, -210.0], [8e-5, -4e-6, 1.0]])


@pytest.fixture
def points(tmp_path: Path) -> Path:
    rng = np.random.default_rng(0)
    rgb = rng.uniform([150.0, 220.0], [1150.0, 750.0], (24, 2))
    path = tmp_path / "points.npz"
    np.savez(path, rgb_px=rgb, event_px=warp_points(rgb, TRUE) + rng.normal(0, 0.5, (24, 2)))
    return path


def test_the_matrix_is_written_and_the_old_one_kept(points: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = points.with_name("rgb_to_event_H.npy")
    old = np.eye(3)
    np.save(out, old)
    report, picture = points.with_name("r.json"), points.with_name("p.png")
    words = ["calibrate", "homography", str(points), "--json", str(report), "--picture", str(picture)]
    assert main(words) == 0
    matrix = np.load(out)
    assert (
        np.hypot(*(warp_points(np.array([[640.0, 480.0]]), matrix) - warp_points(np.array([[640.0, 480.0]]), TRUE)).T)
        < 0.6
    )
    assert np.array_equal(np.load(out.with_name("rgb_to_event_H.npy.bak")), old)
    assert picture.read_bytes()[:4] == b"\x89PNG"
    facts = json.loads(report.read_text())
    assert facts["inliers"] == 24
    assert 0.2 < facts["mean_px"] < facts["p95_px"] < 2.0
    assert "24 of 24" in capsys.readouterr().out
    assert sorted(p.suffix for p in points.parent.iterdir()) == [".bak", ".json", ".npy", ".npz", ".png"]


def test_a_dry_run_writes_no_matrix(points: Path) -> None:
    assert main(["calibrate", "homography", str(points), "--dry-run"]) == 0
    assert list(points.parent.iterdir()) == [points]


def test_degenerate_points_leave_the_old_matrix_alone(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "rgb_to_event_H.npy"
    np.save(out, TRUE)
    (tmp_path / "p.csv").write_text("rgb_x,rgb_y,event_x,event_y\n1,2,3,4\n5,6,7,8\n")
    assert main(["calibrate", "homography", str(tmp_path / "p.csv")]) == 1
    assert "needs 4" in capsys.readouterr().err
    assert np.array_equal(np.load(out), TRUE)


def test_a_place_that_cannot_be_written_is_one_line(points: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["calibrate", "homography", str(points), "--out", str(points / "below" / "h.npy")]) == 1
    assert capsys.readouterr().err.count("\n") == 1
