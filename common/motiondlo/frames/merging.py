"""Joining segments of one DLO over gaps, and the curves that bridge them (paper, "Polyline fitting")."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from motiondlo.frames.params import MergeParams
from motiondlo.frames.types import EndKind

FloatArray = npt.NDArray[np.float64]


@dataclass(frozen=True)
class SegmentEnd:
    """An end of a segment as a candidate for a connection."""

    segment: int
    side: int
    """0 first, 1 last point."""
    point: FloatArray
    """(2,) e_i, px."""
    outward: FloatArray
    """(2,) unit tangent d_i, towards the gap."""
    width: float
    colour: FloatArray
    """(3,) log colour near the end."""
    kind: EndKind = EndKind.UNKNOWN
    """Ends at the image border are never joined; HELD and HIDDEN ends may go on beyond what covers them."""
    maybe_hidden: bool = False
    """Something that is not sure to cover the DLO has an edge here."""


@dataclass(frozen=True)
class Connection:
    """Two ends that belong to one DLO."""

    a: SegmentEnd
    b: SegmentEnd
    score: float


def connection_score(a: SegmentEnd, b: SegmentEnd, max_gap_px: float) -> float:
    """s_ij = -(d_i . d_j) (1 - sqrt(|e_i - e_j| / d_max)) of the paper: aligned tangents, small gaps."""
    gap = float(np.hypot(*(a.point - b.point)))
    return -float(a.outward @ b.outward) * (1.0 - float(np.sqrt(min(gap / max_gap_px, 1.0))))


def is_candidate(a: SegmentEnd, b: SegmentEnd, max_gap_px: float, params: MergeParams) -> bool:
    """Whether two ends may be joined: d_max and the tangent criterion (paper), width, colour, and a reason for the gap.

    The gap must lie ahead of both ends. Past a small gap something must hide the DLO: two cables that lie in line with
    the board between them stay two. If that is seen at one end only (a plate may look like the board), the ends must
    be alike.
    """
    if EndKind.BORDER in (a.kind, b.kind):
        return False
    chord = b.point - a.point
    gap = float(np.hypot(*chord))
    if gap > max_gap_px or -float(a.outward @ b.outward) < params.min_alignment:
        return False
    width = 0.5 * (a.width + b.width)
    ahead = min(float(a.outward @ chord), -float(b.outward @ chord)) / max(gap, 1e-9)
    # Skeletons may overlap by a little; the chord of ends that nearly touch has no direction.
    if gap > 0.7 * width and ahead < params.min_chord_alignment:
        return False
    width_ratio = max(a.width, b.width) / max(min(a.width, b.width), 1e-9)
    colour_jump = float(np.abs(a.colour - b.colour).mean())
    if width_ratio > params.max_width_ratio or colour_jump > params.max_colour_jump:
        return False
    covered = [kind in (EndKind.HELD, EndKind.HIDDEN) for kind in (a.kind, b.kind)]
    if gap <= params.open_gap_w * width or all(covered):
        return True
    alike = width_ratio <= params.alike_width_ratio and colour_jump <= params.alike_colour_jump
    straight = min(ahead, -float(a.outward @ b.outward)) >= params.alike_alignment
    sign = EndKind.HIDDEN in (a.kind, b.kind) or a.maybe_hidden or b.maybe_hidden
    return sign and alike and straight


def connect(ends: list[SegmentEnd], max_gap_px: float, params: MergeParams) -> list[Connection]:
    """Greedy merging in descending score (paper): union-find over segments, each end joined at most once."""
    candidates = [
        Connection(a, b, connection_score(a, b, max_gap_px))
        for i, a in enumerate(ends)
        for b in ends[i + 1 :]
        if a.segment != b.segment and is_candidate(a, b, max_gap_px, params)
    ]
    parent: dict[int, int] = {end.segment: end.segment for end in ends}

    def root(segment: int) -> int:
        while parent[segment] != segment:
            segment = parent[segment]
        return segment

    taken: set[tuple[int, int]] = set()
    accepted = []
    for candidate in sorted(candidates, key=lambda c: -c.score):
        key_a, key_b = (candidate.a.segment, candidate.a.side), (candidate.b.segment, candidate.b.side)
        if candidate.score <= 0.0 or key_a in taken or key_b in taken:
            continue
        if root(candidate.a.segment) == root(candidate.b.segment):
            continue
        parent[root(candidate.a.segment)] = root(candidate.b.segment)
        taken |= {key_a, key_b}
        accepted.append(candidate)
    return accepted


def bezier_bridge(
    start: FloatArray, start_direction: FloatArray, end: FloatArray, end_direction: FloatArray, alpha: float
) -> FloatArray:
    """Cubic Bezier curve over a gap, points about one px apart, both ends left out (paper, c_1 and c_2).

    start_direction: outward tangent into the gap, end_direction: tangent into the segment behind it; unit vectors. The
    control points lie alpha times the gap ahead of the start and before the end. Returns (K, 2), K >= 0.
    """
    gap = float(np.hypot(*(end - start)))
    count = int(gap) - 1
    if count < 1:
        return np.empty((0, 2))
    c1 = start + alpha * gap * start_direction
    c2 = end - alpha * gap * end_direction
    u = (np.arange(1, count + 1) / (count + 1))[:, None]
    v = 1.0 - u
    return np.asarray(v**3 * start + 3 * v**2 * u * c1 + 3 * v * u**2 * c2 + u**3 * end, dtype=np.float64)
