"""How far a held DLO is seen to go on beyond the end that the frame branch gave it."""

from __future__ import annotations

import numpy as np
import pytest

from motiondlo.events.buckets import EventBuckets
from motiondlo.events.types import SensorGeometry
from motiondlo.tracking.inextensible.held_kernels import (
    BEYOND_PX,
    NOT_SEEN_PX,
    PLACES,
    STEP_PX,
    accumulate_presence,
    silhouette_ends,
    silhouette_signs,
)

RADIUS_PX = 8.0


def ends_of(presence):
    out = np.zeros(2)
    silhouette_ends(presence, 0.4, out)
    return out


def test_silhouettes_beyond_the_given_end_are_found(bar_scene, sweep_path) -> None:
    """The bar begins at x = 80; the shape is said to begin 20 px later."""
    scene = bar_scene(sweep_path((0.0, 1.5)))
    buckets = EventBuckets(SensorGeometry(420, 300))
    presence, looks = np.zeros((2, PLACES)), np.zeros(PLACES, np.int64)
    # bright on dark: luminance rises at the silhouette at -radius
    profile = np.zeros((22, 2, 61), np.float32)
    profile[:, 0, 30 - 16] = profile[:, 1, 30 + 16] = 0.5
    for k in range(40):
        buckets.update(scene.batch(k).events)
        y = scene.path(k + 1.0)[1]
        points = np.stack([np.arange(40.0, 304.0, 6.0), np.full(44, y)], axis=1)
        vn = np.full(22, 1.5 if k > 12 else 0.0)
        accumulate_presence(
            buckets.rings, buckets.heads, buckets.columns, buckets.last_us, (k + 1) * 1000, 60.0, 1, 0.0, 6.0, 2,
            points, np.zeros(44), vn, RADIUS_PX, profile, 6.0, 0.0, 0.5, 3.0, 0.05, presence, looks,
        )  # fmt: skip
    assert looks.min() == 27
    assert ends_of(presence) == pytest.approx([-20.0, -20.0], abs=4.0)


def test_signs_of_silhouettes_come_from_the_nearest_profile() -> None:
    rng = np.random.default_rng(3)
    profile = rng.random((4, 2, 61)).astype(np.float32)
    rises = [
        profile[2, 0, 30 + at - 2 : 30 + at + 3].sum() >= profile[2, 1, 30 + at - 2 : 30 + at + 3].sum()
        for at in (-16, 16)
    ]
    assert silhouette_signs(profile, 1.7, RADIUS_PX) == tuple(map(int, rises))
    assert silhouette_signs(profile, -5.0, RADIUS_PX) == silhouette_signs(profile, 0.0, RADIUS_PX)


def test_every_silhouette_ends_at_its_steepest_fall() -> None:
    at = np.arange(PLACES) * STEP_PX - BEYOND_PX
    presence = np.stack([np.where(at >= -30.0, 0.9, 0.0), np.where(at >= -6.0, 0.7, 0.1)])
    assert ends_of(presence) == pytest.approx([-31.0, -7.0])


def test_a_silhouette_does_not_go_on_behind_a_gap() -> None:
    at = np.arange(PLACES) * STEP_PX - BEYOND_PX
    presence = np.where((at >= -6.0) | (at < -20.0), 0.8, 0.05)
    assert ends_of(np.stack([presence, presence])) == pytest.approx([-7.0, -7.0])


def test_a_dlo_without_silhouettes_says_nothing() -> None:
    presence = np.stack([np.full(PLACES, 0.05), np.full(PLACES, 0.9)])
    assert ends_of(presence)[0] == NOT_SEEN_PX
