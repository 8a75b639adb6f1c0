"""A small scene that runs every kernel once, so that the first real update does not compile."""

from __future__ import annotations

import numpy as np

from motiondlo.events.types import EVENT_DTYPE, EventBatch, SensorGeometry
from motiondlo.frames.types import EndKind
from motiondlo.tracking.inextensible.held_kernels import PLACES, silhouette_ends
from motiondlo.tracking.inextensible.params import InextensibleParams
from motiondlo.tracking.types import Correction, CorrectionKind


def run_small_scene(params: InextensibleParams) -> None:
    """Track a bar that moves across a small sensor, held at one end and free at the other, for a few updates."""
    from motiondlo.tracking.inextensible.tracker import InextensibleTracker

    tracker = InextensibleTracker(params, SensorGeometry(320, 200))
    for dlo_id, ends in enumerate(((EndKind.HELD, EndKind.TIP), (EndKind.TIP, EndKind.BORDER))):
        nodes = np.stack([np.linspace(90.0, 240.0, 20), np.full(20, 60.0 + 70.0 * dlo_id)], axis=1)
        tracker.correct(
            Correction(dlo_id, dlo_id, 0, CorrectionKind.REINITIALISE, nodes, np.ones(20), np.ones(20), 12.0, ends)
        )
    rng = np.random.default_rng(0)
    for k in range(16):
        events = np.zeros(2400, EVENT_DTYPE)
        side = rng.integers(0, 2, len(events))
        events["t"] = np.sort(rng.integers(k * 1000, k * 1000 + 1000, len(events)))
        events["x"] = rng.integers(50, 250, len(events))
        events["y"] = 54 + 12 * side + 70 * rng.integers(0, 2, len(events)) + k
        events["p"] = side
        tracker.update(EventBatch(k * 1000, k * 1000 + 1000, events))
    nodes = np.stack([np.linspace(90.0, 240.0, 20), np.full(20, 61.0)], axis=1)
    tracker.correct(Correction(9, 0, 5000, CorrectionKind.BLEND, nodes, np.full(20, 50.0), np.full(20, 50.0), 12.0))
    silhouette_ends(np.zeros((2, PLACES)), params.presence_share, np.zeros(2))
