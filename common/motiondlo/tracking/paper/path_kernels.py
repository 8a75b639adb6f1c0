"""Kernel that finds the longest path through each part of an 8-connected skeleton."""

from __future__ import annotations

import numba
import numpy as np
import numpy.typing as npt


@numba.njit(cache=True, nogil=True)
def _spread(
    start: int,
    index: npt.NDArray[np.int32],
    cells: npt.NDArray[np.int32],
    stamp: npt.NDArray[np.int32],
    mark: int,
    parent: npt.NDArray[np.int32],
    queue: npt.NDArray[np.int32],
) -> int:
    """Breadth-first from cell ``start``; fills ``parent`` and ``queue``, returns how many cells it reached."""
    rows, columns = index.shape
    queue[0] = start
    parent[start] = -1
    stamp[start] = mark
    tail = 1
    head = 0
    while head < tail:
        k = queue[head]
        head += 1
        r = cells[k, 0]
        c = cells[k, 1]
        # Straight neighbours first, so that equal paths prefer them.
        for turn in range(8):
            dr = (0, 0, 1, -1, 1, 1, -1, -1)[turn]
            dc = (1, -1, 0, 0, 1, -1, 1, -1)[turn]
            rr = r + dr
            cc = c + dc
            if rr < 0 or cc < 0 or rr >= rows or cc >= columns:
                continue
            j = index[rr, cc]
            if j >= 0 and stamp[j] != mark:
                stamp[j] = mark
                parent[j] = k
                queue[tail] = j
                tail += 1
    return tail


@numba.njit(cache=True, nogil=True)
def longest_paths(
    skeleton: npt.NDArray[np.uint8], shortest_cells: int
) -> tuple[npt.NDArray[np.int32], npt.NDArray[np.int64]]:
    """The tip-to-tip path of every part of a skeleton: the farthest cell from any cell, then the farthest from that.

    skeleton: (h, w) uint8 0/1. Returns the paths' cells (K, 2) int32 as (column, row), one path after the other, and
    their ends (P,) int64 in it; paths of fewer than ``shortest_cells`` cells are left out. On a part with cycles,
    cycles are cut where the two ways around meet.
    """
    rows, columns = skeleton.shape
    count = 0
    for r in range(rows):
        for c in range(columns):
            count += skeleton[r, c] != 0
    cells = np.empty((count, 2), np.int32)
    index = np.full((rows, columns), -1, np.int32)
    n = 0
    for r in range(rows):
        for c in range(columns):
            if skeleton[r, c] != 0:
                cells[n, 0] = r
                cells[n, 1] = c
                index[r, c] = n
                n += 1
    stamp = np.zeros(count, np.int32)
    parent = np.empty(count, np.int32)
    queue = np.empty(count, np.int32)
    path = np.empty((count, 2), np.int32)
    ends = np.empty(count, np.int64)
    written = 0
    parts = 0
    mark = 0
    for k in range(count):
        if stamp[k] != 0:
            continue
        mark += 1
        reached = _spread(k, index, cells, stamp, mark, parent, queue)
        if reached < shortest_cells:
            continue
        mark += 1
        reached = _spread(queue[reached - 1], index, cells, stamp, mark, parent, queue)
        j = queue[reached - 1]
        first = written
        while j >= 0:
            path[written, 0] = cells[j, 1]
            path[written, 1] = cells[j, 0]
            written += 1
            j = parent[j]
        if written - first < shortest_cells:
            written = first
            continue
        ends[parts] = written
        parts += 1
    return path[:written], ends[:parts]
