"""Point pairs of two cameras: read from files, checked before anything is fitted to them."""

from __future__ import annotations

import csv
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
import numpy.typing as npt

from motiondlo.errors import CalibrationError
from motiondlo.geometry.homography_fit import normalising

FloatArray = npt.NDArray[np.float64]

_LEAST_THICKNESS = 0.02
_SMALL_SHARE = 0.15
_ALIKE_PX = 1e-3
_COLUMNS = ("rgb_x", "rgb_y", "event_x", "event_y")
_REMEDY = "Give 4 pairs or more, better 20, spread over the image that both cameras see."


@dataclass(frozen=True)
class PointPairs:
    """The same places in both images."""

    rgb_px: FloatArray
    """(N, 2)."""
    event_px: FloatArray
    """(N, 2)."""
    origin: str
    """What they come from, for messages."""

    def __len__(self) -> int:
        """Number of pairs."""
        return len(self.rgb_px)


def load_point_pairs(path: Path) -> PointPairs:
    """Read ``.npz`` (``rgb_px``, ``event_px``: (N, 2)) or ``.csv`` (columns rgb_x, rgb_y, event_x, event_y).

    Raises CalibrationError naming the file and what is wrong with it.
    """
    if not path.is_file():
        raise CalibrationError(f"{path}: no such file.", "Give a .npz or .csv file of point pairs.")
    if path.suffix == ".npz":
        rgb, event = _from_npz(path)
    elif path.suffix == ".csv":
        rgb, event = _from_csv(path)
    else:
        raise CalibrationError(f"{path}: neither .npz nor .csv.", "Give a .npz or .csv file of point pairs.")
    return PointPairs(rgb, event, str(path))


def check_point_pairs(pairs: PointPairs, event_size_px: tuple[int, int]) -> list[str]:
    """Refuse what determines no homography; returns warnings for what determines a poor one.

    Raises CalibrationError for fewer than four pairs, shapes that differ, values that are not finite, points that lie
    on a line (also all but one of them), and fewer than four distinct places.
    """
    where = pairs.origin
    for name, points in (("rgb_px", pairs.rgb_px), ("event_px", pairs.event_px)):
        if points.ndim != 2 or points.shape[1] != 2:
            raise CalibrationError(f"{where}: {name} has shape {points.shape}, expected (N, 2).", _REMEDY)
        if not np.isfinite(points).all():
            raise CalibrationError(f"{where}: {name} holds values that are not finite.", "Remove those pairs.")
    if pairs.rgb_px.shape != pairs.event_px.shape:
        raise CalibrationError(
            f"{where}: {len(pairs.rgb_px)} rgb and {len(pairs.event_px)} event points.", "List them in pairs."
        )
    if len(pairs) < 4:
        raise CalibrationError(f"{where}: {len(pairs)} point pairs, a homography needs 4.", _REMEDY)
    warnings = []
    for name, points in (("rgb", pairs.rgb_px), ("event", pairs.event_px)):
        distinct = len(np.unique(np.rint(points / _ALIKE_PX), axis=0))
        if distinct < 4:
            raise CalibrationError(f"{where}: only {distinct} distinct {name} points, 4 are needed.", _REMEDY)
        if distinct < len(points):
            warnings.append(f"{len(points) - distinct} {name} points are repeated")
        if _is_line(points):
            raise CalibrationError(f"{where}: the {name} points (all, or all but one) lie on a line.", _REMEDY)
    share = covered_share(pairs.event_px, event_size_px)
    if share < _SMALL_SHARE:
        warnings.append(f"the points cover {100 * share:.0f} % of the event image: far from them the map is a guess")
    if len(pairs) < 8:
        warnings.append(f"only {len(pairs)} pairs: a wrong one can hardly be told")
    return warnings


def covered_share(event_px: FloatArray, event_size_px: tuple[int, int]) -> float:
    """Share of the event image inside the points' convex hull."""
    hull = cv2.convexHull(event_px.astype(np.float32))
    return float(cv2.contourArea(hull)) / (event_size_px[0] * event_size_px[1])


def _is_line(points: FloatArray) -> bool:
    """Whether the points, or all but one of them, are (nearly) collinear."""
    unit = points * normalising(points)[0, 0]
    subsets = [unit, *(np.delete(unit, k, axis=0) for k in range(len(unit)))] if len(unit) <= 200 else [unit]
    for subset in subsets:
        spread = np.linalg.svd(subset - subset.mean(axis=0), compute_uv=False)
        if spread[1] < _LEAST_THICKNESS * max(float(spread[0]), 1e-12):
            return True
    return False


def _from_npz(path: Path) -> tuple[FloatArray, FloatArray]:
    try:
        with np.load(path, allow_pickle=False) as archive:
            if missing := [name for name in ("rgb_px", "event_px") if name not in archive]:
                raise CalibrationError(f"{path}: has no {' and no '.join(missing)}.", "It needs rgb_px and event_px.")
            rgb, event = archive["rgb_px"], archive["event_px"]
    except (OSError, ValueError, EOFError) as error:
        raise CalibrationError(f"{path}: not a readable .npz file ({error}).", "Write it again.") from error
    try:
        return rgb.astype(np.float64), event.astype(np.float64)
    except (TypeError, ValueError) as error:
        raise CalibrationError(f"{path}: holds no numbers ({error}).", "Write it again.") from error


def _from_csv(path: Path) -> tuple[FloatArray, FloatArray]:
    try:
        with path.open(newline="", encoding="utf-8") as file:
            reader = csv.DictReader(file, skipinitialspace=True)
            missing = [name for name in _COLUMNS if name not in (reader.fieldnames or ())]
            if missing:
                raise CalibrationError(
                    f"{path}: no column {missing[0]}.", f"The first line names the columns: {','.join(_COLUMNS)}."
                )
            rows = [[_number(path, reader.line_num, row[name]) for name in _COLUMNS] for row in reader]
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise CalibrationError(f"{path}: not a readable .csv file ({error}).", "Write it again.") from error
    values = np.array(rows, dtype=np.float64).reshape(-1, 4)
    return values[:, :2].copy(), values[:, 2:].copy()


def _number(path: Path, line: int, text: str | None) -> float:
    try:
        return float(text or "")
    except ValueError as error:
        raise CalibrationError(f"{path}, line {line}: {text!r} is no number.", "Correct the line.") from error
