"""Skeleton of a mask as a graph of branches (paper, "Polyline fitting": 8-connected pixel graph)."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

from motiondlo.frames.masks import Mask
from motiondlo.frames.thinning_kernels import degrees, remove_corners, thin, walk

FloatArray = npt.NDArray[np.float64]

FREE = -1
"""Node number of a branch end that is no junction."""


@dataclass(frozen=True)
class Branch:
    """A run of skeleton pixels between two nodes."""

    path: FloatArray
    """(K, 2) float64 (x, y), working px, in order."""
    radius: FloatArray
    """(K,) distance to the mask's edge, working px."""
    nodes: tuple[int, int]
    """Junction numbers at the first and last pixel; FREE for a tip."""

    @property
    def length(self) -> float:
        """Arc length, working px."""
        return float(np.hypot(*np.diff(self.path, axis=0).T).sum()) if len(self.path) > 1 else 0.0

    @property
    def width(self) -> float:
        """Median width, working px."""
        return float(2.0 * np.median(self.radius))

    def reversed(self) -> Branch:
        """The same branch from its other end."""
        return Branch(self.path[::-1], self.radius[::-1], (self.nodes[1], self.nodes[0]))


@dataclass(frozen=True)
class SkeletonGraph:
    """Branches and the junctions that they meet in."""

    branches: tuple[Branch, ...]
    junction_radius: dict[int, float]
    """Distance to the mask's edge at every junction, working px."""


def skeletonise(mask: Mask) -> Mask:
    """One pixel wide medial axis without staircase corners. (h, w) uint8 0/1 -> the same.

    The mask goes on beyond the image border, so that a DLO that leaves the image is thinned up to the border.
    """
    pad = 24
    padded = cv2.copyMakeBorder(mask, pad, pad, pad, pad, cv2.BORDER_REPLICATE)
    padded[[0, -1], :] = 0
    padded[:, [0, -1]] = 0
    ys, xs = np.nonzero(padded)
    thin(padded, ys.astype(np.int32), xs.astype(np.int32))
    ys, xs = np.nonzero(padded)
    remove_corners(padded, ys.astype(np.int32), xs.astype(np.int32))
    return np.ascontiguousarray(padded[pad:-pad, pad:-pad])


def distance_inside(mask: Mask) -> npt.NDArray[np.float32]:
    """Distance of mask pixels to the edge; the image border is no edge. (h, w) -> (h, w) float32 px."""
    pad = 24
    padded = cv2.copyMakeBorder(mask, pad, pad, pad, pad, cv2.BORDER_REPLICATE)
    inner = cv2.distanceTransform(padded, cv2.DIST_L2, 5)
    return np.asarray(inner[pad:-pad, pad:-pad], dtype=np.float32)


def build_graph(skeleton: Mask, radius: npt.NDArray[np.float32]) -> SkeletonGraph:
    """Split a skeleton into branches between junctions (clusters of pixels of degree three or more) and tips.

    skeleton: (h, w) uint8 0/1, radius: (h, w) float32. Rings without a junction have no ends and are left out: a DLO
    has two.
    """
    mask = cv2.copyMakeBorder(skeleton, 1, 1, 1, 1, cv2.BORDER_CONSTANT, value=0)
    degree = np.zeros_like(mask)
    degrees(mask, degree)
    crowded = np.asarray(degree >= 3, dtype=np.uint8)
    _, labels = cv2.connectedComponents(crowded, connectivity=8)
    node = np.asarray(labels, dtype=np.int32)
    centre = _cluster_centres(node)
    visited = np.zeros_like(mask)
    buffer = np.empty((int(mask.sum()) + 4, 2), np.int32)
    branches: list[Branch] = []

    def record(count: int, start: int) -> None:
        path = buffer[:count].copy()
        ends = (start - 1, int(node[path[-1, 0], path[-1, 1]]) - 1)
        xy = np.asarray(path[:, ::-1] - 1, dtype=np.float64)
        radii = np.asarray(radius[path[:, 0] - 1, path[:, 1] - 1], dtype=np.float64)
        for end, index in zip(ends, (0, -1), strict=True):
            if end != FREE:
                xy[index] = centre[end + 1] - 1.0
        branches.append(Branch(xy, radii, ends))

    for y, x in np.argwhere(crowded):
        for v, u in _around(mask, int(y), int(x)):
            if node[v, u] == 0 and not visited[v, u]:
                record(walk(mask, node, visited, int(y), int(x), v, u, buffer), int(node[y, x]))
    for y, x in np.argwhere((degree == 1) & (node == 0)):
        if not visited[y, x]:
            visited[y, x] = 1
            v, u = _around(mask, int(y), int(x))[0]
            record(walk(mask, node, visited, int(y), int(x), v, u, buffer), 0)
    radii_at = {k - 1: float(radius[round(c[1]) - 1, round(c[0]) - 1]) for k, c in centre.items()}
    return SkeletonGraph(tuple(branches), radii_at)


def prune_spurs(graph: SkeletonGraph, spur_radii: float) -> SkeletonGraph:
    """Remove free branches shorter than ``spur_radii`` local radii, then dissolve junctions of two branches.

    Thinning leaves such a spur at every bump of the mask's edge; a true free end is longer than the DLO is wide. The
    shortest go first, so that of a forked tip one prong survives.
    """
    branches = list(graph.branches)
    while True:
        spurs = []
        for k, branch in enumerate(branches):
            tips = branch.nodes.count(FREE)
            if tips == 1:
                junction = max(branch.nodes)
                reach = max(graph.junction_radius.get(junction, 0.0), float(np.median(branch.radius)))
                if branch.length < spur_radii * reach:
                    spurs.append((branch.length, k))
        if not spurs:
            break
        del branches[min(spurs)[1]]
        branches = _dissolve(branches)
    return SkeletonGraph(tuple(_dissolve(branches)), graph.junction_radius)


def _dissolve(branches: list[Branch]) -> list[Branch]:
    """Join the two branches of every junction that only two branch ends meet in."""
    result = list(branches)
    while True:
        ends: dict[int, list[tuple[int, int]]] = {}
        for k, branch in enumerate(result):
            for side in (0, 1):
                if branch.nodes[side] != FREE:
                    ends.setdefault(branch.nodes[side], []).append((k, side))
        pair = next((e for e in ends.values() if len(e) == 2 and e[0][0] != e[1][0]), None)
        if pair is None:
            return result
        (i, side_i), (j, side_j) = pair
        first = result[i] if side_i == 1 else result[i].reversed()
        second = result[j] if side_j == 0 else result[j].reversed()
        joined = Branch(
            np.concatenate([first.path, second.path[1:]]),
            np.concatenate([first.radius, second.radius[1:]]),
            (first.nodes[0], second.nodes[1]),
        )
        result = [b for k, b in enumerate(result) if k not in (i, j)] + [joined]


def _cluster_centres(node: npt.NDArray[np.int32]) -> dict[int, FloatArray]:
    """Mean (x, y) of the pixels of every label above 0."""
    ys, xs = np.nonzero(node)
    labels = node[ys, xs]
    counts = np.bincount(labels)
    x = np.bincount(labels, weights=xs) / np.maximum(counts, 1)
    y = np.bincount(labels, weights=ys) / np.maximum(counts, 1)
    return {k: np.array([x[k], y[k]]) for k in range(1, len(counts))}


def _around(mask: Mask, y: int, x: int) -> list[tuple[int, int]]:
    """Set 8-neighbours, straight ones first."""
    steps = ((-1, 0), (0, 1), (1, 0), (0, -1), (-1, -1), (-1, 1), (1, 1), (1, -1))
    return [(y + dy, x + dx) for dy, dx in steps if mask[y + dy, x + dx]]
