"""A synthetic cable: a straight bar that moves across its own line and makes events at both edges."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from motiondlo.events.types import EVENT_DTYPE, EventArray, EventBatch
from motiondlo.tracking.types import Correction, CorrectionKind

SweepingBar = Callable[[int, int, float], EventArray]


@pytest.fixture(scope="session")
def sweeping_bar() -> SweepingBar:
    """events(t0_us, t1_us, speed_px_ms): a horizontal bar from x = 300 to 900, 20 px wide, at y = 200 + speed t."""

    def events(t0_us: int, t1_us: int, speed_px_ms: float) -> EventArray:
        rng = np.random.default_rng(t0_us)
        out = []
        for t_us in range(t0_us, t1_us, 250):
            y = 200.0 + speed_px_ms * t_us / 1000.0
            for edge, polarity in ((10.0, 1), (-10.0, 0)):
                x = rng.choice(np.arange(300, 901), 150, replace=False)
                part = np.zeros(len(x), EVENT_DTYPE)
                part["t"], part["x"], part["y"], part["p"] = t_us, np.sort(x), round(y + edge), polarity
                out.append(part)
        return np.concatenate(out) if out else np.zeros(0, EVENT_DTYPE)

    return events


def batches(events: EventArray, t1_us: int, period_us: int) -> list[EventBatch]:
    """Cut events into batches on the period's grid."""
    edges = range(0, t1_us, period_us)
    cuts = np.searchsorted(events["t"], [*edges, t1_us])
    return [EventBatch(t, t + period_us, events[a:b]) for t, a, b in zip(edges, cuts[:-1], cuts[1:], strict=True)]


@pytest.fixture(scope="session")
def cut() -> Callable[[EventArray, int, int], list[EventBatch]]:
    """cut(events, t1_us, period_us)."""
    return batches


@pytest.fixture
def bar_start() -> Correction:
    """The bar at rest at t = 0, as a frame sees it: REINITIALISE of DLO 3."""
    nodes = np.stack([np.linspace(300.0, 900.0, 40), np.full(40, 200.0)], axis=1)
    return Correction(0, 3, 0, CorrectionKind.REINITIALISE, nodes, np.ones(40), np.full(40, 3.0), 20.0)
