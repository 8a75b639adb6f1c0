"""Point pairs from files; what determines no homography is refused, what determines a poor one is warned of."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from motiondlo.calibration.point_pairs import PointPairs, check_point_pairs, load_point_pairs
from motiondlo.errors import CalibrationError

SIZE = (1280, 720)
RNG = np.random.default_rng(0)
SPREAD = RNG.uniform([50.0, 50.0], [1230.0, 670.0], (20, 2))
LINE = np.stack([np.linspace(0, 1000, 20), np.linspace(0, 500, 20) + RNG.normal(0, 0.5, 20)], axis=1)
LINE_AND_ONE = np.concatenate([LINE, [[900.0, 20.0]]])


def pairs(rgb: np.ndarray[tuple[int, ...], np.dtype[np.float64]], event: object = None) -> PointPairs:
    return PointPairs(rgb, rgb + 5.0 if event is None else np.asarray(event, dtype=np.float64), "points")


def test_spread_points_have_no_warning() -> None:
    assert check_point_pairs(pairs(SPREAD), SIZE) == []


@pytest.mark.parametrize(
    ("bad", "what"),
    [
        (pairs(SPREAD[:3]), "3 point pairs"),
        (pairs(LINE), "line"),
        (pairs(LINE_AND_ONE), "line"),
        (pairs(np.repeat(SPREAD[:3], 4, axis=0)), "only 3 distinct"),
        (pairs(SPREAD, np.tile(SPREAD[:1], (20, 1))), "distinct event"),
        (pairs(SPREAD, SPREAD[:10]), "20 rgb and 10 event"),
        (pairs(np.full((5, 2), np.nan)), "not finite"),
        (pairs(np.zeros((5, 3))), "shape"),
        (pairs(np.zeros((0, 2))), "0 point pairs"),
    ],
)
def test_degenerate_pairs_are_refused(bad: PointPairs, what: str) -> None:
    with pytest.raises(CalibrationError, match=what):
        check_point_pairs(bad, SIZE)


def test_points_in_a_small_part_and_few_points_are_warned_of() -> None:
    warnings = check_point_pairs(pairs(SPREAD[:6] / 10.0), SIZE)
    assert any("cover" in text for text in warnings)
    assert any("6 pairs" in text for text in warnings)


def test_both_kinds_of_file_are_read(tmp_path: Path) -> None:
    np.savez(tmp_path / "p.npz", rgb_px=SPREAD, event_px=SPREAD + 1)
    rows = "\n".join(f"{a},{b},{c},{d}" for (a, b), (c, d) in zip(SPREAD, SPREAD + 1, strict=True))
    (tmp_path / "p.csv").write_text(f"rgb_x,rgb_y,event_x,event_y\n{rows}\n")
    for name in ("p.npz", "p.csv"):
        read = load_point_pairs(tmp_path / name)
        assert np.allclose(read.rgb_px, SPREAD)
        assert np.allclose(read.event_px, SPREAD + 1)


@pytest.mark.parametrize(
    ("name", "content", "what"),
    [
        ("p.csv", "a,b\n1,2\n", "no column rgb_x"),
        ("p.csv", "rgb_x,rgb_y,event_x,event_y\n1,2,3,x\n", "line 2"),
        ("p.csv", "rgb_x,rgb_y,event_x,event_y\n1,2,3\n", "no number"),
        ("p.npz", "nonsense", "not a readable"),
        ("p.txt", "1 2 3 4", "neither"),
    ],
)
def test_files_that_are_none_are_refused_by_name(tmp_path: Path, name: str, content: str, what: str) -> None:
    (tmp_path / name).write_text(content)
    with pytest.raises(CalibrationError, match=what):
        load_point_pairs(tmp_path / name)
    with pytest.raises(CalibrationError, match="no such file"):
        load_point_pairs(tmp_path / "absent.npz")
