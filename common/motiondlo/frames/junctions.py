"""Which branches belong together at crossings (paper, "Polyline fitting": junction-aware traversal)."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import combinations

import numpy as np
import numpy.typing as npt

from motiondlo.frames.params import GraphParams
from motiondlo.frames.skeleton_graph import FREE, Branch, SkeletonGraph
from motiondlo.geometry.curve import arc_length

FloatArray = npt.NDArray[np.float64]

_MAX_ENDS = 8
"""Branch ends that are paired exhaustively (105 perfect matchings); at a wilder place the thinnest are left out."""


@dataclass(frozen=True)
class BranchEnd:
    """One end of a branch at a crossing, measured beyond the zone where the mask of both DLOs is one."""

    branch: int
    side: int
    """0 the branch's first, 1 its last pixel."""
    point: FloatArray
    """(2,) where the branch stands on its own, working px."""
    outward: FloatArray
    """(2,) unit tangent towards the crossing."""
    width: float
    colour: FloatArray
    """(3,) median log colour on the branch near this end."""


@dataclass(frozen=True)
class Crossing:
    """Branch ends that meet in one place: a junction, or several that short shared stretches connect."""

    ends: tuple[BranchEnd, ...]


Pairing = tuple[tuple[int, int], ...]
"""Pairs of indices into a crossing's ends."""


def find_crossings(
    graph: SkeletonGraph, image_log: npt.NDArray[np.float32], params: GraphParams
) -> tuple[list[Crossing], set[int]]:
    """Group junctions into crossings. Returns them, and the branches that are shared stretches (no DLO of their own).

    Thinning turns an X into two Ys with a stretch between them that belongs to both DLOs; the flatter the crossing the
    longer the stretch. It is told from a DLO's own branch by its length (below a width), or by being wider.
    """
    groups = _JunctionGroups(graph)
    # Short stretches first, so that the wider ones are compared with all branches that meet in a crossing.
    shared = {k for k, branch in enumerate(graph.branches) if _is_short(branch)}
    for k in shared:
        groups.join(*graph.branches[k].nodes)
    wide = {k for k in range(len(graph.branches)) if k not in shared and _is_wide(k, shared, graph, groups, params)}
    for k in wide:
        groups.join(*graph.branches[k].nodes)
    shared |= wide
    members: dict[int, list[tuple[int, int]]] = {}
    for k, branch in enumerate(graph.branches):
        for side in (0, 1):
            if k not in shared and branch.nodes[side] != FREE:
                members.setdefault(groups.root(branch.nodes[side]), []).append((k, side))
    crossings = []
    for ends in members.values():
        measured = [measure_end(graph, k, side, image_log, params) for k, side in ends]
        if len(measured) > _MAX_ENDS:
            measured = sorted(measured, key=lambda end: -end.width)[:_MAX_ENDS]
        crossings.append(Crossing(tuple(measured)))
    return crossings, shared


class _JunctionGroups:
    """Union-find over junctions."""

    def __init__(self, graph: SkeletonGraph) -> None:
        self._parent = {node: node for branch in graph.branches for node in branch.nodes if node != FREE}

    def root(self, node: int) -> int:
        while self._parent[node] != node:
            node = self._parent[node]
        return node

    def join(self, a: int, b: int) -> None:
        self._parent[self.root(a)] = self.root(b)


def _is_short(branch: Branch) -> bool:
    """Whether a stretch between two junctions is no longer than the mask is wide there: the middle of an X."""
    a, b = branch.nodes
    return a not in (b, FREE) and b != FREE and branch.length < 1.1 * float(2.0 * np.mean(branch.radius))


def _is_wide(index: int, short: set[int], graph: SkeletonGraph, groups: _JunctionGroups, params: GraphParams) -> bool:
    """Whether a stretch is wider than the thickest DLO at either end of it: two DLOs side by side in one mask.

    A stretch between two crossings of a thick DLO with thin ones is as wide as the thick one, and stays its own.
    """
    branch = graph.branches[index]
    a, b = branch.nodes
    if FREE in (a, b) or groups.root(a) == groups.root(b):
        return False
    thickest = []
    for node in (groups.root(a), groups.root(b)):
        widths = [
            other.width
            for k, other in enumerate(graph.branches)
            if k != index
            and k not in short
            and any(n != FREE and groups.root(n) == node for n in other.nodes)
            and other.length > 1.5 * other.width
        ]
        if widths:
            thickest.append(max(widths))
    width = min(thickest) if thickest else branch.width
    wider = float(2.0 * np.mean(branch.radius)) > params.bridge_widening * width
    return wider and branch.length < params.bridge_length_w * width


def measure_end(
    graph: SkeletonGraph, index: int, side: int, image_log: npt.NDArray[np.float32], params: GraphParams
) -> BranchEnd:
    """Place, tangent, width and colour of a branch end, past the crossing's influence (about one junction radius)."""
    branch = graph.branches[index] if side == 0 else graph.branches[index].reversed()
    s = arc_length(branch.path)
    width = branch.width
    reach = max(graph.junction_radius.get(branch.nodes[0], 0.0), 0.5 * width)
    skip = min(1.3 * reach, 0.4 * s[-1])
    stretch = min(params.tangent_length_w * width, s[-1] - skip)
    part = (s >= skip) & (s <= skip + max(stretch, 3.0))
    if int(part.sum()) < 2:
        part = np.ones(len(s), dtype=bool)
    u = s[part] - s[part][0]
    degree = 2 if int(part.sum()) > 6 and u[-1] > 1.2 * width else 1
    fit = np.polynomial.polynomial.polyfit(u, branch.path[part], min(degree, int(part.sum()) - 1))
    point, direction = fit[0], -fit[1]
    rows = np.clip(branch.path[part].round().astype(np.int64), 0, None)
    height, image_width = image_log.shape[:2]
    ys, xs = np.minimum(rows[:, 1], height - 1), np.minimum(rows[:, 0], image_width - 1)
    colour = np.median(image_log[ys, xs].astype(np.float64), axis=0)
    near_width = float(2.0 * np.median(branch.radius[part]))
    return BranchEnd(index, side, point, direction / max(np.hypot(*direction), 1e-9), near_width, colour)


def pair_score(a: BranchEnd, b: BranchEnd, params: GraphParams) -> float:
    """How well two branch ends continue one another; 1 is perfect, paper's term minus penalties past the paper.

    Paper: the collinearity t_a . t_b of the tangents (signed here, so that a branch never turns back on its neighbour).
    Past it: the bend of the smoothest connection, which also sees a sideways offset, and jumps of width and colour.
    """
    collinearity = -float(a.outward @ b.outward)
    chord = b.point - a.point
    gap = float(np.hypot(*chord))
    bend = 0.0
    if gap > 0.3 * (a.width + b.width) * 0.5:
        alpha = _angle(chord, a.outward)
        beta = _angle(chord, -b.outward)
        bend = alpha * alpha + alpha * beta + beta * beta
    width_jump = abs(float(np.log(max(a.width, 1e-6) / max(b.width, 1e-6))))
    colour_jump = min(float(np.abs(a.colour - b.colour).mean()), 1.5)
    return (
        collinearity - params.bend_weight * bend - params.width_weight * width_jump - params.colour_weight * colour_jump
    )


def _angle(u: FloatArray, v: FloatArray) -> float:
    return float(np.arctan2(u[0] * v[1] - u[1] * v[0], u @ v))


def ranked_pairings(crossing: Crossing, params: GraphParams, keep: int = 12) -> list[tuple[float, Pairing]]:
    """The best one-to-one pairings of a crossing's ends, best first (paper: argmax over all valid pairings).

    An end may stay alone: a pair counts for its score less ``min_pair_score``.
    """
    count = len(crossing.ends)
    gain = {
        (i, j): pair_score(crossing.ends[i], crossing.ends[j], params) - params.min_pair_score
        for i, j in combinations(range(count), 2)
    }
    pairings = [(sum(gain[pair] for pair in pairing), pairing) for pairing in _pairings(tuple(range(count)))]
    pairings.sort(key=lambda item: -item[0])
    return pairings[:keep]


def _pairings(ends: tuple[int, ...]) -> Iterator[Pairing]:
    """All ways to pair ends one to one, leaving any of them alone."""
    if not ends:
        yield ()
        return
    first, rest = ends[0], ends[1:]
    yield from _pairings(rest)
    for k, partner in enumerate(rest):
        for pairing in _pairings(rest[:k] + rest[k + 1 :]):
            yield ((first, partner), *pairing)
