"""From branches and pairings to ordered centrelines, one per DLO (paper, "Polyline fitting": constrained traversal)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from motiondlo.frames.junctions import BranchEnd, Crossing, Pairing, find_crossings, ranked_pairings
from motiondlo.frames.merging import bezier_bridge
from motiondlo.frames.params import GraphParams
from motiondlo.frames.skeleton_graph import SkeletonGraph
from motiondlo.geometry.curve import arc_length

FloatArray = npt.NDArray[np.float64]

_MAX_REPAIRS = 8


@dataclass(frozen=True)
class Chain:
    """An ordered centreline before smoothing."""

    path: FloatArray
    """(K, 2) (x, y) working px."""
    radius: FloatArray
    """(K,) distance to the mask's edge, working px; NaN where the path bridges a crossing or a gap."""
    source: int = -1
    """Number of the single DLO's mask that it comes from; -1 where masks do not tell DLOs apart."""

    @property
    def length(self) -> float:
        """Arc length, working px."""
        return float(arc_length(self.path)[-1])

    @property
    def width(self) -> float:
        """Median width, working px."""
        own = self.radius[np.isfinite(self.radius)]
        return float(2.0 * np.median(own)) if len(own) else 0.0


Link = dict[tuple[int, int], tuple[BranchEnd, BranchEnd]]


def traverse(graph: SkeletonGraph, image_log: npt.NDArray[np.float32], params: GraphParams) -> list[Chain]:
    """Walk from each end through the paired branches until the next end.

    Pairings that close a ring are replaced by the next best that does not: a DLO has two ends.
    """
    crossings, shared = find_crossings(graph, image_log, params)
    ranked = [ranked_pairings(crossing, params) for crossing in crossings]
    choice = [0] * len(crossings)
    own = [k for k in range(len(graph.branches)) if k not in shared]
    for _ in range(_MAX_REPAIRS):
        links = _links(crossings, [r[c][1] for r, c in zip(ranked, choice, strict=True)])
        rings = _walks(graph, own, links)[1]
        if not rings:
            break
        if not _repair(crossings, ranked, choice, set(rings[0]), graph, own):
            break
    links = _links(crossings, [r[c][1] for r, c in zip(ranked, choice, strict=True)])
    walks, rings = _walks(graph, own, links)
    return [_assemble(graph, walk, links) for walk in walks]


def _links(crossings: list[Crossing], pairings: list[Pairing]) -> Link:
    links: Link = {}
    for crossing, pairing in zip(crossings, pairings, strict=True):
        for i, j in pairing:
            a, b = crossing.ends[i], crossing.ends[j]
            links[(a.branch, a.side)] = (a, b)
            links[(b.branch, b.side)] = (b, a)
    return links


Walk = list[tuple[int, int]]
"""Branches in order, each with the side that is entered."""


def _walks(graph: SkeletonGraph, own: list[int], links: Link) -> tuple[list[Walk], list[list[int]]]:
    """Chains of branches, and rings (as lists of branches)."""
    used: set[int] = set()
    walks: list[Walk] = []
    starts = [(k, side) for k in own for side in (0, 1) if (k, side) not in links]
    for start in starts:
        if start[0] in used:
            continue
        walks.append(_follow(start, links, used))
    rings = []
    for k in own:
        if k not in used:
            rings.append([branch for branch, _ in _follow((k, 0), links, used)])
    return walks, rings


def _follow(start: tuple[int, int], links: Link, used: set[int]) -> Walk:
    walk: Walk = []
    at: tuple[int, int] | None = start
    while at is not None and at[0] not in used:
        branch, side = at
        used.add(branch)
        walk.append((branch, side))
        link = links.get((branch, 1 - side))
        at = (link[1].branch, link[1].side) if link else None
    return walk


def _repair(
    crossings: list[Crossing],
    ranked: list[list[tuple[float, Pairing]]],
    choice: list[int],
    ring: set[int],
    graph: SkeletonGraph,
    own: list[int],
) -> bool:
    """Change one crossing on the ring to the pairing that opens it at the least loss; False if none does."""
    best: tuple[float, int, int] | None = None
    before = len(_walks(graph, own, _links(crossings, [r[c][1] for r, c in zip(ranked, choice, strict=True)]))[1])
    for k, crossing in enumerate(crossings):
        if not any(end.branch in ring for end in crossing.ends):
            continue
        for option in range(choice[k] + 1, len(ranked[k])):
            loss = ranked[k][choice[k]][0] - ranked[k][option][0]
            if best is not None and loss >= best[0]:
                break
            trial = [option if i == k else c for i, c in enumerate(choice)]
            links = _links(crossings, [r[c][1] for r, c in zip(ranked, trial, strict=True)])
            if len(_walks(graph, own, links)[1]) < before:
                best = (loss, k, option)
                break
    if best is None:
        return False
    choice[best[1]] = best[2]
    return True


def _assemble(graph: SkeletonGraph, walk: Walk, links: Link) -> Chain:
    """Concatenate the branches of a walk, cut back at crossings to where each stands on its own, bridged smoothly."""
    paths: list[FloatArray] = []
    radii: list[FloatArray] = []
    for position, (index, side) in enumerate(walk):
        branch = graph.branches[index] if side == 0 else graph.branches[index].reversed()
        entry = links.get((index, side)) if position > 0 else None
        leave = links.get((index, 1 - side)) if position + 1 < len(walk) else None
        first, last = 0, len(branch.path)
        if entry is not None:
            first = min(int(np.hypot(*(branch.path - entry[0].point).T).argmin()), last - 1)
        if leave is not None:
            last = max(int(np.hypot(*(branch.path - leave[0].point).T).argmin()) + 1, first + 1)
        paths.append(branch.path[first:last])
        radii.append(branch.radius[first:last])
        if leave is not None:
            a, b = leave
            bridge = bezier_bridge(a.point, a.outward, b.point, -b.outward, alpha=0.4)
            paths.append(bridge)
            radii.append(np.full(len(bridge), np.nan))
    path, radius = np.concatenate(paths), np.concatenate(radii)
    moved = np.concatenate(([True], np.hypot(*np.diff(path, axis=0).T) > 1e-6))
    return Chain(path[moved], radius[moved])
