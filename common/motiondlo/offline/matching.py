"""Which estimated id is which true DLO, and how often the nearest id changes.

Costs are distances in event px; D DLOs, I ids, G grid times.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from scipy.optimize import linear_sum_assignment

from motiondlo.offline.ground_truth import GroundTruth
from motiondlo.offline.nearest import places_on
from motiondlo.offline.tracks import Tracks

FloatArray = npt.NDArray[np.float64]

FRESH_US = 20_000
"""An estimate counts for this long."""
_NEARER = 0.7
_IN_A_ROW = 3


def match_ids(tracks: Tracks, truth: GroundTruth) -> dict[int, int]:
    """Match ids to DLOs one to one by mean distance, at the first time at which every id has an estimate.

    Returns {index of the DLO: id}; DLOs without an id are absent, and ids beyond the number of DLOs are left over.
    """
    ids = tracks.known_ids()
    if not ids:
        return {}
    rows = [tracks.estimates_of(i) for i in ids]
    at_us = max(int(tracks.times_us[own[0]]) for own in rows)
    newest = np.array([own[np.searchsorted(tracks.times_us[own], at_us, side="right") - 1] for own in rows])
    nodes = tracks.nodes[newest].astype(np.float64)
    cost = np.stack(
        [
            places_on(truth.nodes_at(dlo, tracks.times_us[newest]), nodes).distance.mean(axis=1)
            for dlo in range(truth.count)
        ]
    )
    dlos, columns = linear_sum_assignment(cost)
    return {int(dlo): ids[column] for dlo, column in zip(dlos, columns, strict=True)}


def latest_rows(row_times_us: npt.NDArray[np.int64], grid_us: npt.NDArray[np.int64]) -> npt.NDArray[np.intp]:
    """Index of the last row at or before each grid time, -1 before the first. (R,), (G,) -> (G,)."""
    return np.asarray(np.searchsorted(row_times_us, grid_us, side="right") - 1, dtype=np.intp)


def distances_on_grid(tracks: Tracks, truth: GroundTruth, dlo: int, grid_us: npt.NDArray[np.int64]) -> FloatArray:
    """Mean distance of the visible true nodes to each id's latest estimate at each grid time.

    Returns (I, G) px in the order of ``tracks.known_ids()``, infinite where the id has no estimate yet or nothing of
    the DLO is visible. Estimates of any age are used: :func:`count_switches` is told which are fresh.
    """
    ids = tracks.known_ids()
    result = np.full((len(ids), len(grid_us)), np.inf)
    true_nodes = truth.nodes_at(dlo, grid_us)
    seen = truth.visibility[dlo, truth.nearest_index(grid_us)] == 0
    for row, track_id in enumerate(ids):
        own = tracks.estimates_of(track_id)
        latest = latest_rows(tracks.times_us[own], grid_us)
        use = (latest >= 0) & seen.any(axis=1)
        if use.any():
            curves = tracks.nodes[own[latest[use]]].astype(np.float64)
            result[row, use] = np.average(
                places_on(curves, true_nodes[use]).distance, axis=1, weights=seen[use].astype(np.float64)
            )
    return result


def fresh_on_grid(tracks: Tracks, grid_us: npt.NDArray[np.int64]) -> npt.NDArray[np.bool_]:
    """(I, G) whether each id has an estimate in the 20 ms before each grid time."""
    fresh = np.zeros((len(tracks.known_ids()), len(grid_us)), np.bool_)
    for row, track_id in enumerate(tracks.known_ids()):
        times_us = tracks.times_us[tracks.estimates_of(track_id)]
        latest = latest_rows(times_us, grid_us)
        fresh[row] = (latest >= 0) & (grid_us - times_us[np.maximum(latest, 0)] <= FRESH_US)
    return fresh


def count_switches(distance: FloatArray, fresh: npt.NDArray[np.bool_], start: int) -> int:
    """How often the id nearest to a DLO changes, beginning with the matched id ``start`` (a row index).

    A change counts when another id with a fresh estimate is nearer by at least 30 % at three grid times in a row.
    distance, fresh: (I, G).
    """
    challenger = np.where(fresh, distance, np.inf)
    current, rival, streak, switches = start, -1, 0, 0
    for g in range(distance.shape[1]):
        best = int(challenger[:, g].argmin())
        nearer = best != current and challenger[best, g] <= _NEARER * distance[current, g]
        if not nearer or not np.isfinite(challenger[best, g]):
            rival, streak = -1, 0
            continue
        streak = streak + 1 if best == rival else 1
        rival = best
        if streak == _IN_A_ROW:
            current, rival, streak = best, -1, 0
            switches += 1
    return switches
