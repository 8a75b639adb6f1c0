"""Joining segments of one DLO over gaps, and the curves that bridge them (paper, "Polyline fitting")."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from motiondlo.frames.covers import Cover
from motiondlo.frames.params import MergeParams
from motiondlo.frames.types import EndKind

FloatArray = npt.NDArray[np.float64]

_LOOKS_AWAY_RAD, _ONE_MASK_AWAY_RAD = 1.05, 1.4
_TOUCH_PX = 6.0
_WIDTH_ERROR_PX = 1.0
_UNLIKE_COST = 2.0
"""Of two connections the one of like looks is preferred."""


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
    rigid: bool = False
    """The segment may be a part of a gripper."""
    source: int = -1
    """Number of the single DLO's mask that the segment was found in, -1 for none."""


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


def is_candidate(
    a: SegmentEnd, b: SegmentEnd, max_gap_px: float, params: MergeParams, cover: Cover | None = None
) -> bool:
    """Whether two ends may be joined: d_max and the tangent criterion (paper), width, colour, and a reason for the gap.

    The gap must lie ahead of both ends. Past a small gap something must hide the DLO: two cables that lie in line with
    the board between them stay two. If that is seen at one end only (a plate may look like the board), the ends must
    be alike; alike ends that something hides may also turn towards each other, as far as a DLO bends.
    """
    if EndKind.BORDER in (a.kind, b.kind):
        return False
    chord = b.point - a.point
    gap = float(np.hypot(*chord))
    width = 0.5 * (a.width + b.width)
    # Of a wire one edge or the other may be its highlight's.
    width_ratio = max(max(a.width, b.width) - _WIDTH_ERROR_PX, 1e-9) / max(min(a.width, b.width), 1e-9)
    colour_jump = colour_difference(a, b)
    if gap > max_gap_px or width_ratio > params.max_width_ratio or colour_jump > params.max_colour_jump:
        return False
    open_gap = gap <= params.open_gap_w * width
    # A segmenter that gives both pieces as one DLO has its reason.
    one_mask = a.source >= 0 and a.source == b.source
    hidden = one_mask or all(kind in (EndKind.HELD, EndKind.HIDDEN) for kind in (a.kind, b.kind))
    if cover is not None and gap > width:
        hidden |= float(cover.at(_bridge(a, b)).mean()) >= params.min_cover
    alike = width_ratio <= params.alike_width_ratio and colour_jump <= params.alike_colour_jump
    alignment = -float(a.outward @ b.outward)
    ahead = min(float(a.outward @ chord), -float(b.outward @ chord)) / max(gap, 1e-9)
    # Skeletons may overlap by a little; the chord of ends that nearly touch has no direction.
    if EndKind.HELD in (a.kind, b.kind) and (a.rigid or b.rigid) and not open_gap:
        return False
    touch = gap <= max(0.7 * width, _TOUCH_PX)
    if not (alignment >= params.min_alignment and (touch or ahead >= params.min_chord_alignment)):
        if one_mask:
            return not touch and bend_w(a, b, _ONE_MASK_AWAY_RAD) <= 2.0 * params.max_bend_w
        # A plate that the empty board's picture shows hides both ends.
        hidden |= all(end.kind in (EndKind.HELD, EndKind.HIDDEN) or end.maybe_hidden for end in (a, b))
        return hidden and alike and not touch and bend_w(a, b) <= params.max_bend_w
    if open_gap or hidden:
        return True
    sign = EndKind.HIDDEN in (a.kind, b.kind) or a.maybe_hidden or b.maybe_hidden
    return sign and alike and min(ahead, alignment) >= params.alike_alignment


def colour_difference(a: SegmentEnd, b: SegmentEnd) -> float:
    """Mean difference of the log colours; brightness counts half: the way a DLO runs under the light changes it."""
    difference = a.colour - b.colour
    brightness = float(difference.mean())
    return float(np.abs(difference - brightness).mean()) + 0.5 * abs(brightness)


def bend_w(a: SegmentEnd, b: SegmentEnd, looks_away_rad: float = _LOOKS_AWAY_RAD) -> float:
    """Width over the radius (root mean square) of the smoothest curve from one end to the other; inf if one looks away.

    With the angles alpha, beta of its end tangents to the chord, a cubic of length L bends with the mean square
    4 (alpha^2 + alpha beta + beta^2) / L^2.
    """
    chord = b.point - a.point
    gap = float(np.hypot(*chord))
    alpha, beta = _angle(chord, a.outward), _angle(chord, -b.outward)
    if max(abs(alpha), abs(beta)) > looks_away_rad:
        return float("inf")
    mean_width = 0.5 * (a.width + b.width)
    return float(2.0 * mean_width / max(gap, 1e-9) * np.sqrt(max(alpha**2 + alpha * beta + beta**2, 0.0)))


def _angle(u: FloatArray, v: FloatArray) -> float:
    return float(np.arctan2(u[0] * v[1] - u[1] * v[0], u @ v))


def _bridge(a: SegmentEnd, b: SegmentEnd) -> FloatArray:
    """The part of a connection that should be hidden: soft edges and shadows at both ends left out."""
    curve = bezier_bridge(a.point, a.outward, b.point, -b.outward, alpha=0.4)
    margin = min(int(0.25 * (a.width + b.width)), len(curve) // 4)
    return curve[margin : len(curve) - margin]


def connect(
    ends: list[SegmentEnd], max_gap_px: float, params: MergeParams, cover: Cover | None = None
) -> list[Connection]:
    """Greedy merging in descending score (paper): union-find over segments, each end joined at most once.

    cover: what could hide a DLO; without it only the kinds of the ends say that something does.
    """
    candidates = [
        Connection(a, b, _rank(a, b, max_gap_px))
        for i, a in enumerate(ends)
        for b in ends[i + 1 :]
        if a.segment != b.segment and is_candidate(a, b, max_gap_px, params, cover)
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


def _rank(a: SegmentEnd, b: SegmentEnd, max_gap_px: float) -> float:
    """The paper's score, or that of a bent connection (the worse tangent to the chord), less for unlike looks."""
    chord = b.point - a.point
    gap = float(np.hypot(*chord))
    worse = min(float(a.outward @ chord), -float(b.outward @ chord)) / max(gap, 1e-9)
    bent = worse * (1.0 - float(np.sqrt(min(gap / max_gap_px, 1.0))))
    unlike = colour_difference(a, b) + abs(float(np.log(max(a.width, 1e-6) / max(b.width, 1e-6))))
    score = max(connection_score(a, b, max_gap_px), bent) * float(np.exp(-_UNLIKE_COST * unlike))
    # Pieces of one mask come first.
    return score + 1.0 if score > 0.0 and a.source >= 0 and a.source == b.source else score


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
