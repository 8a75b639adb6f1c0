"""Endpoint extension (paper, "Endpoint extension").

"... both endpoints are extended after each registration step along their local outward tangent direction. Candidate
observations are selected from the full, unweighted observation set based on their alignment with the tangent direction
and proximity to the curve axis. The farthest valid observation determines the extension length, which is clipped to
prevent excessive extrapolation. The curve is subsequently resampled to maintain uniform node spacing."
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from motiondlo.geometry.curve import arc_length, point_at, project, resample
from motiondlo.tracking.paper.params import PaperParams

FloatArray = npt.NDArray[np.float64]

# The tangent is taken over two segments: the outermost one alone turns with every observation at the tip.
_TANGENT_NODES = 2
# Shorter gaps are noise of the observations.
_SHORTEST_EXTENSION_PX = 1.0


def extend_ends(
    nodes: FloatArray, observations: FloatArray, diameter_px: float, rest_length_px: float, params: PaperParams
) -> FloatArray:
    """Extend both ends to the last observation ahead of them and resample.

    nodes: (M, 2), observations: (N, 2), event px. rest_length_px: the DLO's known length, 0 where unknown; the paper
    takes a DLO as inextensible, so the extensions together do not make it longer than that plus the tolerance.
    Returns (M, 2).
    """
    allowed = 2.0 * params.extension_clip_px
    if rest_length_px > 0.0:
        allowed = max(rest_length_px * (1.0 + params.length_tolerance) - float(arc_length(nodes)[-1]), 0.0)
    width = params.extension_width_diameters * diameter_px
    head = _gap_ahead(nodes[::-1], observations, width, params.extension_clip_px)
    tail = _gap_ahead(nodes, observations, width, params.extension_clip_px)
    wanted = head + tail
    if wanted > allowed:
        head, tail = head * allowed / wanted, tail * allowed / wanted
    extended = nodes
    if head > _SHORTEST_EXTENSION_PX:
        extended = np.concatenate([nodes[:1] + head * _outward(nodes[::-1]), extended])
    if tail > _SHORTEST_EXTENSION_PX:
        extended = np.concatenate([extended, nodes[-1:] + tail * _outward(nodes)])
    return resample(extended, len(nodes))


def within_reach(points: FloatArray, expected: FloatArray, rest_length_px: float, diameter_px: float) -> FloatArray:
    """Leave out observations that lie further beyond an end than the DLO can reach.

    What holds the DLO moves with it and is seen in line with it: its observations would draw the chain along, update by
    update, without its ever becoming too long. points: (N, 2) observations, expected: (M, 2) predicted nodes.
    rest_length_px: known length, 0 for none (then nothing is left out). Returns (N', 2).
    """
    if rest_length_px <= 0.0:
        return points
    distance, s = project(points, expected)
    length = float(arc_length(expected)[-1])
    reach = max(diameter_px / 2.0, rest_length_px - length)
    beyond = (s <= 0.0) | (s >= length)
    return points[~beyond | (distance <= reach)]


def within_length(nodes: FloatArray, expected: FloatArray, rest_length_px: float, tolerance: float) -> FloatArray:
    """Cut a curve that has become longer than the DLO is (paper, "Problem Statement": L_t is about l at all times).

    Observations of what holds the DLO (a gripper and its arm move too) draw an end beyond its place. Of all pieces with
    the longest length allowed, the one whose ends are nearest to the expected ends is kept, so that the nodes stay
    where they were along the DLO. nodes, expected: (M, 2). rest_length_px: known length, 0 for none. Returns (M, 2).
    """
    s = arc_length(nodes)
    longest = rest_length_px * (1.0 + tolerance)
    if rest_length_px <= 0.0 or s[-1] <= longest:
        return nodes
    starts = np.linspace(0.0, s[-1] - longest, 33)
    heads, tails = point_at(nodes, starts), point_at(nodes, starts + longest)
    miss = ((heads - expected[0]) ** 2).sum(axis=1) + ((tails - expected[-1]) ** 2).sum(axis=1)
    start = float(starts[int(miss.argmin())])
    return point_at(nodes, np.linspace(start, start + longest, len(nodes)))


def _outward(nodes: FloatArray) -> FloatArray:
    """Unit tangent beyond the last node; zero for nodes on one spot."""
    step = nodes[-1] - nodes[-1 - _TANGENT_NODES]
    norm = float(np.hypot(*step))
    return step / norm if norm > 1e-9 else np.zeros(2)


def _gap_ahead(nodes: FloatArray, observations: FloatArray, width_px: float, clip_px: float) -> float:
    """Distance from the last node to the farthest observation ahead of it and within ``width_px`` of the axis.

    Without the clip as a limit of the candidates too, another part of a folded DLO that the axis happens to hit would
    count as the tip.
    """
    tangent = _outward(nodes)
    ahead = (observations - nodes[-1]) @ tangent
    aside = np.abs((observations - nodes[-1]) @ np.array([-tangent[1], tangent[0]]))
    valid = (ahead > 0.0) & (aside < width_px) & (ahead <= 2.0 * clip_px)
    return float(min(ahead[valid].max(), clip_px)) if valid.any() else 0.0
