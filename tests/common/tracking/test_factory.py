"""Profiles by name; warming up compiles everything that a bus-fed tracker will call."""

from __future__ import annotations

import gc

import numba
import numpy as np
import pytest

from motiondlo.errors import ConfigError
from motiondlo.events.types import EventBatch, SensorGeometry, empty_events
from motiondlo.frames.types import EndKind
from motiondlo.tracking.factory import PROFILES, make_tracker, tracker_params, warm_up
from motiondlo.tracking.types import Correction, CorrectionKind


def compiled() -> dict[str, int]:
    """Signatures per kernel of the trackers."""
    # By type: isinstance asks every object for its class, and some libraries' objects answer with a warning.
    kernels = [o for o in gc.get_objects() if issubclass(type(o), numba.core.dispatcher.Dispatcher)]
    return {
        f"{k.py_func.__module__}.{k.py_func.__name__}": len(k.signatures)
        for k in kernels
        if k.py_func.__module__.startswith("motiondlo.tracking")
    }


def sweep(k: int) -> EventBatch:
    """Millisecond k of a bar that moves downwards, its events read-only as the bus delivers them."""
    x = np.arange(300, 900)
    events = empty_events(2 * len(x))
    events["t"] = k * 1000 + np.arange(len(events)) * 999 // len(events)
    events["x"] = np.concatenate([x, x])
    events["y"] = np.repeat([300 + k - 12, 300 + k + 12], len(x))
    events["p"] = np.repeat([0, 1], len(x))
    events.setflags(write=False)
    return EventBatch(k * 1000, (k + 1) * 1000, events)


def shape() -> Correction:
    nodes = np.stack([np.linspace(300.0, 900.0, 50), np.full(50, 300.0)], axis=1)
    sigma = np.full(50, 1.0)
    for array in (nodes, sigma):
        array.setflags(write=False)
    return Correction(
        seq=1,
        id=0,
        t_us=0,
        kind=CorrectionKind.REINITIALISE,
        nodes=nodes,
        sigma_normal_px=sigma,
        sigma_tangent_px=5.0 * sigma,
        diameter_px=24.0,
        ends=(EndKind.TIP, EndKind.HELD),
    )


@pytest.mark.parametrize("profile", PROFILES)
def test_nothing_is_compiled_once_it_is_warm(profile: str) -> None:
    geometry = SensorGeometry()
    warm_up(profile, {}, geometry)
    before = compiled()
    tracker = make_tracker(profile, {}, geometry)
    assert tracker.correct(shape()) is None
    for k in range(30):
        update = tracker.update(sweep(k))
    assert [track.id for track in update.tracks] == [0]
    assert compiled() == before, "each of these would have cost the event path a stall"


def test_the_default_profile_follows_a_bar() -> None:
    tracker = make_tracker("default", {}, SensorGeometry())
    tracker.correct(shape())
    for k in range(60):
        update = tracker.update(sweep(k))
    (track,) = update.tracks
    inner = (track.nodes[:, 0] > 350) & (track.nodes[:, 0] < 850)
    assert np.abs(track.nodes[inner, 1] - 360.0).max() < 3.0
    assert track.moving
    assert abs(np.median(track.velocity_px_s[inner, 1]) - 1000.0) < 200.0


def test_parameters_are_checked_by_profile() -> None:
    assert tracker_params("paper", {"nodes": 30}).model_dump()["nodes"] == 30
    with pytest.raises(ConfigError, match="nonsense"):
        tracker_params("default", {"nonsense": 1})
    with pytest.raises(ConfigError, match="best"):
        make_tracker("best", {}, SensorGeometry())
