"""Runs every kernel once on a made-up cable, so that the first real update waits for no compiler."""

from __future__ import annotations

import numpy as np

from motiondlo.events.types import EVENT_DTYPE, EventBatch, SensorGeometry, empty_events
from motiondlo.frames.types import Appearance, EndKind
from motiondlo.tracking.chain.params import ChainParams
from motiondlo.tracking.types import Correction, CorrectionKind


def exercise(params: ChainParams) -> None:
    """Track a straight cable that moves downwards for some milliseconds, and correct it once."""
    from motiondlo.tracking.chain.tracker import ChainTracker

    tracker = ChainTracker(params, SensorGeometry(320, 240))
    nodes = np.stack([np.linspace(90.0, 230.0, 30), np.full(30, 100.0)], axis=1)
    columns = np.arange(-48, 49)
    strip = np.where(np.abs(columns) <= 10, 0.0, -2.0)[None] * np.ones((151, 1))
    strip[:8:2] = -1.0
    look = Appearance(strip.astype(np.float32), np.ones_like(strip, np.uint8), s0_px=-80.0)
    sigma = np.ones(30)
    start = Correction(
        1, 1, 0, CorrectionKind.REINITIALISE, nodes, sigma, sigma, 20.0, (EndKind.HELD, EndKind.TIP), look
    )
    tracker.correct(start)
    for k in range(12):
        t0_us = 1000 * k
        tracker.update(EventBatch(t0_us, t0_us + 1000, _edges(t0_us, 100.0 + k)))
    tracker.correct(Correction(2, 1, 6000, CorrectionKind.BLEND, nodes + np.array([0.0, 6.0]), sigma, sigma))
    tracker.update(EventBatch(12_000, 13_000, empty_events()))


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
