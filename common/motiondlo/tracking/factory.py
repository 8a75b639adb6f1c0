"""Trackers by profile name: the one place that knows which classes there are."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import numpy.typing as npt
from pydantic import BaseModel

from motiondlo.config.validation import validated
from motiondlo.errors import ConfigError
from motiondlo.events.types import EventBatch, SensorGeometry, empty_events
from motiondlo.frames.types import EndKind
from motiondlo.tracking.types import Correction, CorrectionKind, EventTracker

PROFILES = ("default", "paper")


def tracker_params(profile: str, overrides: Mapping[str, Any]) -> BaseModel:
    """The profile's parameters with ``overrides`` (field name -> value). Raises ConfigError naming what is wrong."""
    if profile == "default":
        from motiondlo.tracking.inextensible.params import InextensibleParams

        return validated(InextensibleParams, overrides, "tracker")
    if profile == "paper":
        from motiondlo.tracking.paper.params import PaperParams

        return validated(PaperParams, overrides, "tracker")
    raise ConfigError(f"profile {profile!r} is not known.", f"Use one of: {', '.join(PROFILES)}.")


def make_tracker(
    profile: str, overrides: Mapping[str, Any], geometry: SensorGeometry, timed: bool = False
) -> EventTracker:
    """A tracker of the profile for a sensor; ``timed``: its updates tell the host's time per stage.

    Raises ConfigError for an unknown profile or a wrong override.
    """
    params = tracker_params(profile, overrides)
    if profile == "paper":
        from motiondlo.tracking.paper.params import PaperParams
        from motiondlo.tracking.paper.tracker import PaperTracker

        assert isinstance(params, PaperParams)
        return PaperTracker(params, geometry)
    from motiondlo.tracking.inextensible.params import InextensibleParams
    from motiondlo.tracking.inextensible.tracker import InextensibleTracker

    assert isinstance(params, InextensibleParams)
    return InextensibleTracker(params, geometry, timed=timed)


def warm_up(profile: str, overrides: Mapping[str, Any], geometry: SensorGeometry) -> None:
    """Compile, or load from the cache, every kernel of the profile: made-up DLOs, at rest and moving, for a moment."""
    tracker = make_tracker(profile, overrides, geometry)
    if profile == "default":
        from motiondlo.tracking.inextensible.tracker import InextensibleTracker

        assert isinstance(tracker, InextensibleTracker)
        tracker.warm_up()  # a scene of its own reaches what the sweep below does not: grippers, covers, new ends
    y = geometry.height_px / 2.0
    nodes = np.stack([np.linspace(0.2, 0.8, 40) * geometry.width_px, np.full(40, y)], axis=1)
    sigma = np.full(40, 1.0)
    nodes.setflags(write=False)
    sigma.setflags(write=False)
    tracker.correct(
        Correction(
            seq=1,
            id=0,
            t_us=0,
            kind=CorrectionKind.REINITIALISE,
            nodes=nodes,
            sigma_normal_px=sigma,
            sigma_tangent_px=5.0 * sigma,
            diameter_px=24.0,
            ends=(EndKind.HELD, EndKind.TIP),
        )
    )
    tracker.correct(
        Correction(
            seq=2,
            id=0,
            t_us=5_000,
            kind=CorrectionKind.BLEND,
            nodes=nodes,
            sigma_normal_px=sigma,
            sigma_tangent_px=5.0 * sigma,
            diameter_px=24.0,
            ends=(EndKind.HELD, EndKind.TIP),
            not_before_us=20_000,
        )
    )
    for k in range(60):
        tracker.update(_sweeping_edges(k, nodes, y))


def _sweeping_edges(k: int, nodes: npt.NDArray[np.float64], y: float) -> EventBatch:
    """The events of a line that moves 1 px downwards in 1 ms, its two edges 24 px apart, for the k-th millisecond."""
    x = np.arange(int(nodes[0, 0]), int(nodes[-1, 0]), dtype=np.int64)
    events = empty_events(2 * len(x))
    events["t"] = k * 1000 + np.sort(np.arange(2 * len(x)) % 1000)
    events["x"] = np.concatenate([x, x])
    events["y"] = np.concatenate([np.full(len(x), y + k - 12), np.full(len(x), y + k + 12)]).astype(np.int64)
    events["p"] = np.repeat([0, 1], len(x))
    events.setflags(write=False)  # as what the bus delivers: kernels are compiled for it separately
    return EventBatch(k * 1000, (k + 1) * 1000, events)
