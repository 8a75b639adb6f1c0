"""Which segmented instance is which track: curve distance, overlap and looks, one to one, by the Hungarian method."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.optimize import linear_sum_assignment

from motiondlo.frames.types import Appearance, Instance
from motiondlo.geometry.curve import distance_to_curve, project
from motiondlo.tracking.types import TrackState

FloatArray = npt.NDArray[np.float64]

_TRIMMED = 0.8
"""Share of the nearest nodes that counts: an instance may reach farther than the track, or the reverse."""
_OVERLAP_PX = 20.0
"""What curves without any overlap are charged, px of distance."""
_WIDTH_PX = 20.0
"""What a width that differs by a factor of e is charged."""
_LOOKS_PX = 20.0
"""What log-luminances that differ by 1 on average are charged."""
_LOOKS_MOST = 1.0
"""Highlights and shadows move: looks alone never cost more than this."""


@dataclass(frozen=True)
class Match:
    """An instance and the track that it is, with the distance of their curves."""

    instance: int
    track: int
    distance_px: float


def curve_distance(a: FloatArray, b: FloatArray) -> float:
    """How far apart two curves are where they overlap, px: trimmed mean distance, from the one that fits better.

    a: (M, 2), b: (N, 2). One curve may be a part of the other (cut by the image border or hidden).
    """
    return min(_trimmed(distance_to_curve(a, b)), _trimmed(distance_to_curve(b, a)))


def same_direction(nodes: FloatArray, reference: FloatArray) -> bool:
    """Whether ``nodes`` (M, 2) run along ``reference`` (N, 2) from its first to its last node."""
    _, s = project(nodes, reference)
    rising = np.diff(s)
    return float(rising.sum()) >= 0.0 if np.abs(rising).sum() > 0 else True


def looks_difference(a: Appearance | None, b: Appearance | None) -> float:
    """Mean difference of two DLOs' median cross profiles (log-luminance), 0 where either is unknown.

    A DLO seen from its other end has its profile turned round: the better of both counts.
    """
    if a is None or b is None or a.strip.size == 0 or b.strip.size == 0:
        return 0.0
    p, q = np.median(a.strip, axis=0).astype(np.float64), np.median(b.strip, axis=0).astype(np.float64)
    width = min(len(p), len(q))
    p, q = _middle(p, width), _middle(q, width)
    return float(min(np.abs(p - q).mean(), np.abs(p - q[::-1]).mean()))


def _middle(profile: FloatArray, width: int) -> FloatArray:
    start = (len(profile) - width) // 2
    return profile[start : start + width]


def associate(
    instances: Sequence[Instance],
    curves: Sequence[FloatArray],
    tracks: Sequence[TrackState],
    looks: Mapping[int, Appearance | None],
    max_px: float,
) -> list[Match]:
    """One-to-one matches of instances to tracks with the least sum of costs.

    curves: each instance's (M, 2) event px; looks: by track id, what is known of it. Pairs whose curves are farther
    apart than ``max_px`` are never matched.
    """
    if not curves or not tracks:
        return []
    shape = (len(curves), len(tracks))
    distance, cost = np.empty(shape), np.empty(shape)
    for i, (instance, curve) in enumerate(zip(instances, curves, strict=True)):
        for j, track in enumerate(tracks):
            there, back = distance_to_curve(curve, track.nodes), distance_to_curve(track.nodes, curve)
            distance[i, j] = min(_trimmed(there), _trimmed(back))
            overlap = min((there < max_px).mean(), (back < max_px).mean())
            width = 0.0
            if instance.diameter_px > 0.0 and track.diameter_px > 0.0:
                width = abs(float(np.log(instance.diameter_px / track.diameter_px)))
            unlike = min(looks_difference(instance.appearance, looks.get(track.id)), _LOOKS_MOST)
            cost[i, j] = distance[i, j] + _OVERLAP_PX * (1.0 - overlap) + _WIDTH_PX * width + _LOOKS_PX * unlike
    rows, columns = linear_sum_assignment(np.where(distance <= max_px, cost, cost + 1e3 * max_px))
    return [
        Match(int(i), int(j), float(distance[i, j]))
        for i, j in zip(rows, columns, strict=True)
        if distance[i, j] <= max_px
    ]


def _trimmed(distances: FloatArray) -> float:
    d = np.sort(distances)
    return float(d[: max(1, round(_TRIMMED * len(d)))].mean())
