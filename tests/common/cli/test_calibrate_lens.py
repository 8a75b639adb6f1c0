"""``motiondlo calibrate lens`` as a person uses it, with boards that are drawn through a lens."""

from __future__ import annotations

import json
from pathlib import Path

import cv2
import numpy as np
import numpy.typing as npt
import pytest

from motiondlo.calibration.boards import Board, charuco_board
from motiondlo.cli.main import main
from motiondlo.geometry.lens import LensModel, load_lens

SIZE = (640, 480)
TRUE = LensModel(
    np.array([[700.0, 0.0, 322.0], [0.0, 700.0, 238.0], [0.0, 0.0, 1.0]]), np.array([-0.15, 0.06, 0.0, 0.0, 0.0]), SIZE
)
SQUARE_PX = 60


def photograph(turn: npt.NDArray[np.float64], shift: npt.NDArray[np.float64]) -> npt.NDArray[np.uint8]:
    """A ChArUco board of 8x6 squares, in front of a grey wall."""
    board = charuco_board(Board("charuco", 8, 6)).generateImage((8 * SQUARE_PX, 6 * SQUARE_PX), marginSize=0)
    x, y = np.meshgrid(np.arange(SIZE[0], dtype=np.float64), np.arange(SIZE[1], dtype=np.float64))
    seen = np.stack([x.ravel(), y.ravel()], axis=1)
    k, exact = TRUE.camera_matrix, (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_MAX_ITER, 20, 1e-5)
    ideal = cv2.undistortPointsIter(seen[:, None], k, TRUE.distortion, np.eye(3), k, exact)[:, 0]
    rotation = cv2.Rodrigues(turn)[0]
    plane = TRUE.camera_matrix @ np.column_stack([rotation[:, 0], rotation[:, 1], shift])
    on_board = cv2.perspectiveTransform(ideal[None], np.linalg.inv(plane))[0]
    at = (on_board * SQUARE_PX - 0.5).astype(np.float32).reshape(SIZE[1], SIZE[0], 2)
    drawn = cv2.remap(
        cv2.GaussianBlur(board, (0, 0), 1.0), at[..., 0], at[..., 1], cv2.INTER_LINEAR, borderValue=(140,)
    )
    return np.asarray(cv2.GaussianBlur(drawn, (0, 0), 0.6), dtype=np.uint8)


@pytest.fixture(scope="module")
def pictures(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("board")
    rng = np.random.default_rng(0)
    for k in range(9):
        axis = 2 * np.pi * k / 9
        turn = 0.45 * np.array([np.cos(axis), np.sin(axis), 0.0])
        place = np.array([-1.0 + k % 3, -1.0 + k // 3]) * (2.0, 1.4)
        shift = np.array([place[0] - 4.0, place[1] - 3.0, rng.uniform(11.0, 12.5)])
        cv2.imwrite(str(folder / f"{k}.png"), photograph(turn, shift))
    return folder


def test_a_lens_file_is_written_that_the_cell_reads(
    pictures: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out, report, picture = tmp_path / "rgb_lens.json", tmp_path / "r.json", tmp_path / "p.png"
    words = ["calibrate", "lens", str(pictures), "--board", "charuco:8x6", "--out", str(out)]
    assert main([*words, "--json", str(report), "--picture", str(picture)]) == 0
    lens = load_lens(out)
    assert lens.size_px == SIZE
    assert lens.camera_matrix[0, 0] == pytest.approx(700.0, rel=0.01)
    assert lens.largest_shift_px() == pytest.approx(TRUE.largest_shift_px(), rel=0.15)
    facts = json.loads(report.read_text())
    assert facts["rms_px"] < 0.3
    assert facts["views"] >= 8
    assert picture.read_bytes()[:4] == b"\x89PNG"
    assert "corners" in capsys.readouterr().out
    assert main(words) == 0
    assert out.with_name("rgb_lens.json.bak").is_file()


def test_a_dry_run_writes_nothing(pictures: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(["calibrate", "lens", str(pictures), "--board", "charuco:8x6", "--dry-run"]) == 0
    assert list(tmp_path.iterdir()) == []


def test_pictures_without_the_board_are_one_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    cv2.imwrite(str(tmp_path / "grey.png"), np.full((120, 160), 128, np.uint8))
    assert main(["calibrate", "lens", str(tmp_path / "grey.png"), "--out", str(tmp_path / "l.json")]) == 1
    assert "found in 0 of 1" in capsys.readouterr().err
    assert not (tmp_path / "l.json").exists()


def test_pictures_of_different_sizes_are_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for k, size in enumerate(((120, 160), (100, 160))):
        cv2.imwrite(str(tmp_path / f"{k}.png"), np.full(size, 128, np.uint8))
    assert main(["calibrate", "lens", str(tmp_path), "--dry-run"]) == 1
    assert "160x100" in capsys.readouterr().err
