"""The tracker amid events that no DLO makes: a flash, dense noise, a region left out."""

from __future__ import annotations

import numpy as np

from motiondlo.events.types import EVENT_DTYPE, EventBatch
from motiondlo.geometry.curve import distance_to_curve
from motiondlo.tracking.inextensible.params import InextensibleParams
from motiondlo.tracking.inextensible.tracker import InextensibleTracker
from motiondlo.tracking.types import TrackUpdate


def with_noise(batch: EventBatch, count: int, rng: np.random.Generator, scene) -> EventBatch:
    noise = np.zeros(count, EVENT_DTYPE)
    noise["t"] = rng.integers(batch.t0_us, batch.t1_us, count)
    noise["x"] = rng.integers(0, scene.geometry.width_px, count)
    noise["y"] = rng.integers(0, scene.geometry.height_px, count)
    noise["p"] = rng.integers(0, 2, count)
    events = np.concatenate([batch.events, noise])
    return EventBatch(batch.t0_us, batch.t1_us, events[np.argsort(events["t"], kind="stable")])


def error_px(update: TrackUpdate, scene) -> float:
    return float(distance_to_curve(update.tracks[0].nodes, scene.nodes(update.t_us * 1e-3)).mean())


def tracker_of(scene, **params: bool) -> InextensibleTracker:
    tracker = InextensibleTracker(InextensibleParams(**params), scene.geometry)
    assert tracker.correct(scene.correction()) is None
    return tracker


def test_FLASH_is_said_and_bridged_by_prediction(bar_scene, sweep_path) -> None:
    scene, rng = bar_scene(sweep_path((0.0, 1.5))), np.random.default_rng(1)
    tracker = tracker_of(scene)
    pixels = scene.geometry.width_px * scene.geometry.height_px
    said = []
    for k in range(60):
        update = tracker.update(with_noise(scene.batch(k), 3 * pixels if k in (40, 41) else 0, rng, scene))
        if update.disturbed:
            said.append(k)
            assert update.tracks[0].source == "predicted"
            assert update.tracks[0].moving
            assert error_px(update, scene) < 1.5
    assert said == [40, 41]
    assert error_px(update, scene) < 1.0
    assert tracker.screening.report()["flashes"] == 1


def test_DENSE_NOISE_over_a_slow_dlo_is_expected_and_does_not_pull(bar_scene, sweep_path) -> None:
    scene = bar_scene(sweep_path((0.0, 0.3)))
    errors = {}
    for background in (False, True):
        rng = np.random.default_rng(2)
        tracker = tracker_of(scene, background=background, learned_regions=False)
        pixels = scene.geometry.width_px * scene.geometry.height_px
        worst = 0.0
        for k in range(100):
            update = tracker.update(with_noise(scene.batch(k), pixels // 10, rng, scene))
            worst = max(worst, error_px(update, scene))
        errors[background] = worst
    assert errors[True] < 1.5
    assert errors[False] > 5.0


def test_a_region_left_out_hides_a_part_and_the_rest_is_tracked(bar_scene, sweep_path) -> None:
    scene = bar_scene(sweep_path((0.0, 1.5)))
    tracker = tracker_of(scene)
    tracker.screening.set_regions({"display": (140.0, 0.0, 200.0, 1000.0)})
    for k in range(60):
        update = tracker.update(scene.batch(k))
    nodes = update.tracks[0].nodes
    hidden = (nodes[:, 0] > 150.0) & (nodes[:, 0] < 190.0)
    assert error_px(update, scene) < 1.5
    assert not update.tracks[0].visible[hidden].any()
    assert update.tracks[0].visible[nodes[:, 0] < 130.0].mean() > 0.8
