"""Runs every kernel once on a made-up cable, so that the first real update waits for no compiler."""

from __future__ import annotations

import numpy as np

from motiondlo.events.types import EVENT_DTYPE, EventBatch, SensorGeometry, empty_events
from motiondlo.frames.types import Appearance, EndKind
from motiondlo.tracking.chain import patch_kernels
from motiondlo.tracking.chain.end_view import STEP_HALF_PX, PatchScratch
from motiondlo.tracking.chain.params import ChainParams
from motiondlo.tracking.types import Correction, CorrectionKind


def exercise(params: ChainParams) -> None:
    """Track two cables while events sweep over them, correct one, and let both come to rest."""
    from motiondlo.tracking.chain.tracker import ChainTracker

    scratch = PatchScratch()
    patch_kernels.find_step(scratch.a, 64, STEP_HALF_PX, scratch.counts, scratch.out)
    tracker = ChainTracker(params, SensorGeometry(320, 240))
    nodes = np.stack([np.linspace(90.0, 230.0, 30), np.full(30, 100.0)], axis=1)
    columns = np.arange(-48, 49)
    strip = np.where(np.abs(columns) <= 10, 0.0, -2.0)[None] * np.ones((151, 1))
    strip[:38:4] = -1.0
    strip[75:80, 40:57] = -1.5
    look = Appearance(strip.astype(np.float32), np.ones_like(strip, np.uint8), s0_px=-80.0)
    sigma = np.ones(30)
    start = Correction(
        1, 1, 0, CorrectionKind.REINITIALISE, nodes, sigma, sigma, 20.0, (EndKind.HELD, EndKind.TIP), look
    )
    tracker.correct(start)
    other = Correction(
        3, 2, 0, CorrectionKind.REINITIALISE, nodes + np.array([0.0, 60.0]), sigma, sigma, 20.0,
        (EndKind.BORDER, EndKind.HIDDEN),
    )  # fmt: skip
    tracker.correct(other)
    for k in range(24):
        t0_us = 1000 * k
        tracker.update(EventBatch(t0_us, t0_us + 1000, _edges(t0_us, 80.0 + 2 * k)))
    tracker.correct(Correction(4, 1, 6000, CorrectionKind.BLEND, nodes, sigma, sigma))
    for k in range(24, 80):
        tracker.update(EventBatch(1000 * k, 1000 * (k + 1), empty_events()))


def _edges(t0_us: int, y: float) -> np.ndarray:
    """One millisecond of events: both edges of the cable, one pixel down, and a block about its held end."""
    x = np.arange(20, 232)
    rows = [(x, round(y) + 10, 1), (x, round(y) - 10, 0), (x[:60], round(y) + 20, 1), (x[:60], round(y) - 20, 0)]
    events = empty_events(sum(len(r[0]) for r in rows))
    i = 0
    for k, (xs, row, polarity) in enumerate(rows):
        part = events[i : i + len(xs)]
        part["t"] = t0_us + 200 * k
        part["x"] = xs
        part["y"] = row
        part["p"] = polarity
        i += len(xs)
    assert events.dtype == EVENT_DTYPE
    return events
