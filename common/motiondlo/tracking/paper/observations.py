"""Ordered observation points from the mask (paper, "Event Branch: Dynamic DLO").

"The representation that best captures the full visible extent of the DLO is selected and uniformly resampled to produce
a fixed set of ordered observation points X."
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from motiondlo.geometry.curve import arc_length, project, resample
from motiondlo.tracking.paper.centreline import pca_centreline
from motiondlo.tracking.paper.morphology import Mask, dilate
from motiondlo.tracking.paper.params import PaperParams
from motiondlo.tracking.paper.region import Region
from motiondlo.tracking.paper.skeleton_path import skeleton_paths, spread_over
from motiondlo.tracking.paper.stage_clock import StageClock

FloatArray = npt.NDArray[np.float64]

# How far a path's line reaches to its sides when it is asked which part of the mask it accounts for.
_REACH_DIAMETERS = 0.6


@dataclass(frozen=True)
class Observations:
    """What one update saw of the DLO."""

    points: FloatArray
    """(N, 2) event px, ordered along the DLO."""
    path: FloatArray
    """(K, 2) event px: the longest connected centreline, to start a track anew from."""
    from_skeleton: bool


def observe(
    mask: Mask,
    region: Region,
    diameter_px: float,
    expected: FloatArray | None,
    rest_length_px: float,
    params: PaperParams,
    clock: StageClock,
) -> Observations | None:
    """Extract both representations, take the better one, resample it to N points.

    mask: (h, w) uint8 0/1 on the region's cells. expected: (M, 2) event px, the predicted curve by which the parts of
    the skeleton are put into order, or None. rest_length_px: the DLO's known length, 0 for none. Returns None when the
    mask holds no line.
    """
    diameter_cells = diameter_px / region.cell_px
    candidates: list[tuple[float, list[FloatArray], bool]] = []
    if params.pca_centreline:
        line = pca_centreline(mask, params.pca_bins)
        if line is not None:
            candidates.append((_captured(mask, [line], diameter_cells), [line], False))
        clock.lap("pca_centreline")
    if params.skeleton_path:
        paths = skeleton_paths(mask, diameter_cells)
        if paths:
            candidates.append((_captured(mask, paths, diameter_cells), paths, True))
        clock.lap("skeleton_path")
    if not candidates:
        return None
    # On a tie the skeleton, which follows every bend.
    _, paths, from_skeleton = max(candidates, key=lambda c: (c[0], c[2]))
    lines = [region.to_pixels(path) for path in paths]
    ordered = lines if expected is None else _along(expected, lines)
    count = params.observations
    if rest_length_px > 0.0:
        # N points are for the whole DLO: a part of it must not draw the nodes near it with the force of the whole.
        seen_px = sum(float(arc_length(line)[-1]) for line in ordered)
        count = max(round(count * min(seen_px / rest_length_px, 1.0)), 2)
    points = spread_over(ordered, count)
    clock.lap("observations")
    return Observations(points, lines[0], from_skeleton)


def _captured(mask: Mask, paths: list[FloatArray], diameter_cells: float) -> float:
    """How well lines account for the mask: share of the mask near them, times share of them inside the mask.

    The second factor is what a zigzag lacks: it comes near everything by running through the empty middle.
    """
    total = int(mask.sum())
    if total == 0:
        return 0.0
    points = np.concatenate([resample(path, max(int(arc_length(path)[-1]), 2)) for path in paths])
    rows, columns = mask.shape
    column, row = np.round(points).astype(np.int64).T
    known = (column >= 0) & (row >= 0) & (column < columns) & (row < rows)
    column, row = column[known], row[known]
    if len(column) == 0:
        return 0.0
    line = np.zeros_like(mask)
    line[row, column] = 1
    near = dilate(line, max(_REACH_DIAMETERS * diameter_cells, 1.0))
    return float((near & mask).sum() / total) * float(mask[row, column].mean())


def _along(expected: FloatArray, lines: list[FloatArray]) -> list[FloatArray]:
    """Put lines into the order, and each into the direction, in which the expected curve passes them."""
    placed = []
    for line in lines:
        _, s = project(line[[0, len(line) // 2, -1]], expected)
        placed.append((float(s[1]), line if s[0] <= s[2] else line[::-1]))
    return [line for _, line in sorted(placed, key=lambda item: item[0])]
