"""Which segmented instance is which track: curve distance, one to one, by the Hungarian method."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.optimize import linear_sum_assignment

from motiondlo.geometry.curve import distance_to_curve, project
from motiondlo.tracking.types import TrackState

FloatArray = npt.NDArray[np.float64]

_TRIMMED = 0.8
"""Share of the nearest nodes that counts: an instance may reach farther than the track, or the reverse."""


@dataclass(frozen=True)
class Match:
    """An instance and the track that it is, with their distance."""

    instance: int
    track: int
    distance_px: float


def curve_distance(a: FloatArray, b: FloatArray) -> float:
    """How far apart two curves are where they overlap, px: trimmed mean distance, from the one that fits better.

    a: (M, 2), b: (N, 2). One curve may be a part of the other (cut by the image border or hidden).
    """

    def one_way(p: FloatArray, q: FloatArray) -> float:
        d = np.sort(distance_to_curve(p, q))
        return float(d[: max(1, round(_TRIMMED * len(d)))].mean())

    return min(one_way(a, b), one_way(b, a))


def same_direction(nodes: FloatArray, reference: FloatArray) -> bool:
    """Whether ``nodes`` (M, 2) run along ``reference`` (N, 2) from its first to its last node."""
    _, s = project(nodes, reference)
    rising = np.diff(s)
    return float(rising.sum()) >= 0.0 if np.abs(rising).sum() > 0 else True


def associate(curves: Sequence[FloatArray], tracks: Sequence[TrackState], max_px: float) -> list[Match]:
    """One-to-one matches of instance curves (each (M, 2) event px) to tracks with the least sum of distances.

    Pairs farther apart than ``max_px`` are never matched.
    """
    if not curves or not tracks:
        return []
    cost = np.array([[curve_distance(curve, track.nodes) for track in tracks] for curve in curves])
    rows, columns = linear_sum_assignment(np.minimum(cost, 4.0 * max_px))
    return [
        Match(int(i), int(j), float(cost[i, j])) for i, j in zip(rows, columns, strict=True) if cost[i, j] <= max_px
    ]
