"""Zhang-Suen thinning on an active list (paper, "Polyline fitting": iterative morphological thinning)."""

from __future__ import annotations

import numba
import numpy as np
import numpy.typing as npt

Mask = npt.NDArray[np.uint8]


@numba.njit(cache=True, nogil=True)
def _neighbours(mask: Mask, y: int, x: int, p: Mask) -> None:
    """Fill ``p`` (8,) with the neighbours, clockwise from the top."""
    p[0] = mask[y - 1, x]
    p[1] = mask[y - 1, x + 1]
    p[2] = mask[y, x + 1]
    p[3] = mask[y + 1, x + 1]
    p[4] = mask[y + 1, x]
    p[5] = mask[y + 1, x - 1]
    p[6] = mask[y, x - 1]
    p[7] = mask[y - 1, x - 1]


@numba.njit(cache=True, nogil=True)
def thin(mask: Mask, ys: npt.NDArray[np.int32], xs: npt.NDArray[np.int32]) -> None:
    """Thin ``mask`` in place to a skeleton one pixel wide.

    mask: (H, W) uint8 0/1 whose outermost pixels are 0. ys, xs: (N,) int32, all set pixels (overwritten). Only pixels
    that are still set are visited, so a pass costs what is left, not the image.
    """
    p = np.zeros(8, np.uint8)
    n = len(ys)
    gone = np.zeros(n, np.uint8)
    changed = True
    while changed:
        changed = False
        for phase in range(2):
            found = False
            for k in range(n):
                gone[k] = 0
                y, x = ys[k], xs[k]
                _neighbours(mask, y, x, p)
                total = 0
                turns = 0
                for i in range(8):
                    total += p[i]
                    if p[i] == 0 and p[(i + 1) % 8] == 1:
                        turns += 1
                if total < 2 or total > 6 or turns != 1:
                    continue
                if phase == 0:
                    if p[0] * p[2] * p[4] != 0 or p[2] * p[4] * p[6] != 0:
                        continue
                elif p[0] * p[2] * p[6] != 0 or p[0] * p[4] * p[6] != 0:
                    continue
                gone[k] = 1
                found = True
            if found:
                changed = True
                kept = 0
                for k in range(n):
                    if gone[k] == 1:
                        mask[ys[k], xs[k]] = 0
                    else:
                        ys[kept] = ys[k]
                        xs[kept] = xs[k]
                        kept += 1
                n = kept


@numba.njit(cache=True, nogil=True)
def remove_corners(mask: Mask, ys: npt.NDArray[np.int32], xs: npt.NDArray[np.int32]) -> None:
    """Remove staircase corners in place: pixels whose removal keeps their neighbours 8-connected.

    Zhang-Suen leaves L-shaped corners, and each would become a false junction of the graph. A pixel goes when two of
    its 4-neighbours at a right angle are set and its neighbourhood stays in one piece without it; pixels with fewer
    than two neighbours (tips) stay. mask: (H, W) uint8 0/1 with a border of 0; ys, xs: (N,) int32 set pixels.
    """
    p = np.zeros(8, np.uint8)
    for k in range(len(ys)):
        y, x = ys[k], xs[k]
        if mask[y, x] == 0:
            continue
        _neighbours(mask, y, x, p)
        corner = False
        for i in range(0, 8, 2):
            if p[i] == 1 and p[(i + 2) % 8] == 1:
                corner = True
        if not corner:
            continue
        # Number of 8-connected pieces of the ring (Hilditch crossing number on 4-neighbour gaps).
        pieces = 0
        for i in range(0, 8, 2):
            if p[i] == 0 and (p[i + 1] == 1 or p[(i + 2) % 8] == 1):
                pieces += 1
        if pieces == 1:
            mask[y, x] = 0


@numba.njit(cache=True, nogil=True)
def degrees(mask: Mask, out: Mask) -> None:
    """Number of set 8-neighbours of every set pixel. mask, out: (H, W) uint8; the border of ``mask`` is 0."""
    for y in range(1, mask.shape[0] - 1):
        for x in range(1, mask.shape[1] - 1):
            if mask[y, x]:
                out[y, x] = (
                    mask[y - 1, x - 1]
                    + mask[y - 1, x]
                    + mask[y - 1, x + 1]
                    + mask[y, x - 1]
                    + mask[y, x + 1]
                    + mask[y + 1, x - 1]
                    + mask[y + 1, x]
                    + mask[y + 1, x + 1]
                )


@numba.njit(cache=True, nogil=True)
def walk(
    mask: Mask,
    node: npt.NDArray[np.int32],
    visited: Mask,
    y0: int,
    x0: int,
    y1: int,
    x1: int,
    path: npt.NDArray[np.int32],
) -> int:
    """Follow a branch from pixel 0 (a node or a tip) over its neighbour 1 until the next node or the end.

    mask: (H, W) skeleton; node: (H, W) int32, node number + 1 of node pixels, 0 elsewhere; visited: (H, W) marks branch
    pixels; path: (N, 2) int32 receives (y, x), first and last pixel included. Returns the number of pixels.
    """
    path[0, 0], path[0, 1] = y0, x0
    path[1, 0], path[1, 1] = y1, x1
    n = 2
    py, px, y, x = y0, x0, y1, x1
    while node[y, x] == 0 and n < len(path):
        visited[y, x] = 1
        best_y, best_x, best = -1, -1, 99
        for dy in range(-1, 2):
            for dx in range(-1, 2):
                v, u = y + dy, x + dx
                if (dy == 0 and dx == 0) or mask[v, u] == 0 or (v == py and u == px):
                    continue
                if node[v, u] == 0 and visited[v, u] == 1:
                    continue
                # Neighbours of the pixel before are steps sideways at a junction's rim, not forwards. Nodes first.
                rank = abs(dy) + abs(dx)
                if max(abs(v - py), abs(u - px)) <= 1:
                    rank += 10
                if node[v, u] != 0:
                    rank -= 5
                if n == 2 and node[y0, x0] != 0 and node[v, u] == node[y0, x0]:
                    continue
                if rank < best:
                    best, best_y, best_x = rank, v, u
        if best_y < 0:
            break
        py, px, y, x = y, x, best_y, best_x
        path[n, 0], path[n, 1] = y, x
        n += 1
    return n
