"""Errors of one id against one true DLO: the definitions that come with the simulated recordings.

Legend: R estimates of the id, M nodes each, N true nodes. Distances are mm unless a name says px.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from motiondlo.offline.ground_truth import GroundTruth
from motiondlo.offline.matching import FRESH_US, latest_rows
from motiondlo.offline.metrics_kernels import paired_distance, paired_slip, shifted_normal_distance
from motiondlo.offline.nearest import places_on
from motiondlo.offline.tracks import Tracks

FloatArray = npt.NDArray[np.float64]
BoolArray = npt.NDArray[np.bool_]

GRID_US = 5_000
_LOST_MM = 5.0
_SHIFT_BEFORE_US, _SHIFT_AFTER_US = 30_000, 10_000
_SHIFTS_BACK_US = np.concatenate([np.arange(0, -2_000, -100), np.arange(-2_000, -30_001, -500)]).astype(np.int64)
_SHIFTS_ON_US = np.concatenate([np.arange(100, 2_000, 100), np.arange(2_000, 10_001, 500)]).astype(np.int64)


@dataclass(frozen=True)
class Errors:
    """Errors of every estimate of one id, (R,) each; NaN where the definition leaves nothing to measure."""

    times_us: npt.NDArray[np.int64]
    rows: npt.NDArray[np.intp]
    """Row numbers in the tracks."""
    judged: BoolArray
    """Whether the estimate counts: the DLO moves, or for one that never does, anything."""
    ptc_mm: FloatArray
    e_mm: FloatArray
    """In the direction that is better over the judged estimates."""
    cov_mm: FloatArray
    nees: FloatArray
    """Mean over the nodes of (normal distance / sigma) squared; 1 is honest."""
    nees_tangent: FloatArray
    """The same along the curve, of the pairs of ``e_mm``. Where the DLO goes on, hidden, past both ends of what is seen
    of it, the pairs are tied there, and only stretching shows."""
    within: FloatArray
    """(R, 3) share of the nodes with a normal distance below 1, 2 and 3 sigma; honest: 0.68, 0.95, 0.997."""
    speed_mm_s: FloatArray
    """Speed of the DLO's fastest node at the estimate's time."""
    lag_ms: float | None
    """How stale the estimates are; None where it cannot be measured (nothing moves, too short)."""


def judged_grid(truth: GroundTruth, dlo: int) -> npt.NDArray[np.int64]:
    """(G,) times every 5 ms at which a DLO is judged."""
    grid_us = np.arange(truth.times_us[0], truth.times_us[-1] + 1, GRID_US, dtype=np.int64)
    return grid_us[truth.judged(dlo)[truth.nearest_index(grid_us)]]


def judged_seconds(truth: GroundTruth, dlo: int) -> float:
    """For how long a DLO is judged."""
    steps_us = np.diff(truth.times_us, append=truth.times_us[-1])
    return float(steps_us[truth.judged(dlo)].sum()) / 1e6


def lost_fraction(errors: Errors | None, grid_us: npt.NDArray[np.int64]) -> float:
    """Share of the grid times with no estimate in the 20 ms before, or with ``cov`` of the latest one > 5 mm.

    A latest estimate whose ``cov`` is undefined (nothing of the DLO is visible) is not lost.
    """
    if errors is None or not len(errors.times_us):
        return 1.0 if len(grid_us) else 0.0
    if not len(grid_us):
        return 0.0
    latest = latest_rows(errors.times_us, grid_us)
    row = np.maximum(latest, 0)
    absent = (latest < 0) | (grid_us - errors.times_us[row] > FRESH_US)
    return float((absent | (errors.cov_mm[row] > _LOST_MM)).mean())


def errors_of(tracks: Tracks, track_id: int, truth: GroundTruth, dlo: int) -> Errors:
    """All errors of one id against one DLO; the truth is interpolated at each estimate's own time."""
    rows = tracks.estimates_of(track_id)
    times_us = tracks.times_us[rows]
    nodes = tracks.nodes[rows].astype(np.float64)
    true_nodes = truth.nodes_at(dlo, times_us)
    index = truth.nearest_index(times_us)
    seen = truth.visibility[dlo, index] == 0
    judged = truth.judged(dlo)[index]

    to_truth = places_on(true_nodes, nodes)
    inside = (
        (nodes[..., 0] >= -0.5)
        & (nodes[..., 0] < truth.width_px - 0.5)
        & (nodes[..., 1] >= -0.5)
        & (nodes[..., 1] < truth.height_px - 0.5)
    )
    used = inside & np.take_along_axis(seen, to_truth.nearest_node, axis=1)
    with np.errstate(invalid="ignore", divide="ignore"):
        normalised2 = (to_truth.normal_distance / tracks.sigma_px[rows]) ** 2
    measurable = used & np.isfinite(normalised2)
    e_px, nees_tangent = _paired_px(nodes, tracks.sigma_tangent_px[rows].astype(np.float64), true_nodes, seen, judged)
    return Errors(
        times_us=times_us,
        rows=rows,
        judged=judged,
        ptc_mm=_row_means(to_truth.distance, used) / truth.px_per_mm,
        e_mm=e_px / truth.px_per_mm,
        cov_mm=_row_means(places_on(nodes, true_nodes).distance, seen) / truth.px_per_mm,
        nees=_row_means(normalised2, measurable),
        nees_tangent=nees_tangent,
        within=np.stack(
            [_row_means((normalised2 < k * k).astype(np.float64), measurable) for k in (1.0, 2.0, 3.0)], axis=1
        ),
        speed_mm_s=truth.speed_mm_s[dlo, index].astype(np.float64),
        lag_ms=_lag_ms(times_us, nodes, used & judged[:, None], to_truth.segment, truth, dlo),
    )


def _row_means(values: FloatArray, use: BoolArray) -> FloatArray:
    """Mean over the used columns of each row, NaN where there is none. (R, P) -> (R,)."""
    count = use.sum(axis=1)
    total = np.where(use, values, 0.0).sum(axis=1)
    return np.where(count > 0, total / np.maximum(count, 1), np.nan)


def _paired_px(
    nodes: FloatArray, sigma_tangent_px: FloatArray, true_nodes: FloatArray, seen: BoolArray, judged: BoolArray
) -> tuple[FloatArray, FloatArray]:
    """Paired error (R,) px and its tangential NEES (R,): both directions tried, the better one kept for all rows."""
    n = true_nodes.shape[1]
    first = seen.argmax(axis=1)
    last = np.where(seen.any(axis=1), n - 1 - seen[:, ::-1].argmax(axis=1), -1)
    each = np.arange(len(nodes))
    extent_ends = np.stack([true_nodes[each, first], true_nodes[each, last]], axis=1)
    results = []
    slips = []
    for estimate, sigma in ((nodes, sigma_tangent_px), (nodes[:, ::-1].copy(), sigma_tangent_px[:, ::-1].copy())):
        steps = np.hypot(np.diff(estimate[..., 0], axis=1), np.diff(estimate[..., 1], axis=1))
        s = np.concatenate([np.zeros((len(nodes), 1)), np.cumsum(steps, axis=1)], axis=1)
        found = places_on(estimate, extent_ends)
        at = np.take_along_axis(s, found.segment, axis=1)
        at = at + found.fraction * np.take_along_axis(steps, found.segment, axis=1)
        result = np.empty(len(nodes))
        # The cable goes on, hidden, past an end of the visible extent exactly where that end is not its tip.
        cut_first_s = np.where(first > 0, at[:, 0], np.nan)
        cut_last_s = np.where(last < n - 1, at[:, 1], np.nan)
        paired_distance(estimate, true_nodes, first, last, cut_first_s, cut_last_s, result)
        results.append(result)
        slip = np.empty(len(nodes))
        paired_slip(estimate, true_nodes, first, last, cut_first_s, cut_last_s, sigma, slip)
        slips.append(slip)
    counted = [result[judged & np.isfinite(result)] for result in results]
    if not len(counted[0]):
        counted = [result[np.isfinite(result)] for result in results]
    if not len(counted[0]):
        return results[0], slips[0]
    better = int(counted[1].mean() < counted[0].mean())
    return results[better], slips[better]


def _lag_ms(
    times_us: npt.NDArray[np.int64],
    nodes: FloatArray,
    used: BoolArray,
    segment: npt.NDArray[np.int64],
    truth: GroundTruth,
    dlo: int,
) -> float | None:
    """Minus the shift of the truth with the smallest mean normal distance; only where every shift has a truth."""
    if not truth.moved[dlo]:
        return None
    covered = (times_us - _SHIFT_BEFORE_US >= truth.times_us[0]) & (times_us + _SHIFT_AFTER_US <= truth.times_us[-1])
    rows = np.flatnonzero(covered & used.any(axis=1))
    if not len(rows):
        return None
    best_shift_us, best_px = 0, np.inf
    for shifts_us in (_SHIFTS_BACK_US, _SHIFTS_ON_US):
        means_px = np.empty(len(shifts_us))
        shifted_normal_distance(
            nodes[rows],
            used[rows],
            times_us[rows],
            truth.times_us,
            truth.nodes[dlo].astype(np.float64),
            shifts_us,
            segment[rows].copy(),
            means_px,
        )
        i = int(means_px.argmin())
        if means_px[i] < best_px:
            best_shift_us, best_px = int(shifts_us[i]), float(means_px[i])
    return -best_shift_us / 1e3 + 0.0
