"""Stations find their offset from signed, motion-compensated events."""

from __future__ import annotations

import numpy as np
import pytest

from motiondlo.events.buckets import EventBuckets
from motiondlo.events.types import EVENT_DTYPE, SensorGeometry
from motiondlo.tracking.inextensible.collect_kernels import collect_station
from motiondlo.tracking.inextensible.observe_kernels import (
    bin_events,
    is_one_sided,
    learn_profiles,
    observe_stations,
    score_shifts,
)
from motiondlo.tracking.inextensible.params import InextensibleParams
from motiondlo.tracking.inextensible.profiles import log_ratios, prior_profiles, visible_at_start
from motiondlo.tracking.inextensible.rivals import no_rivals

PARAMS = InextensibleParams()
RADIUS_PX = 8.0


def buckets_of(scene, until_ms: int, exchanged: bool = False):
    buckets = EventBuckets(scene.geometry)
    for k in range(until_ms):
        events = scene.batch(k).events
        if exchanged:
            events["p"] = 1 - events["p"]
        buckets.update(events)
    return buckets.rings, buckets.heads, buckets.columns, buckets.background


def station_inputs(points: np.ndarray, vn: float):
    m = len(points)
    full = np.full
    return {
        "points": points, "theta": np.zeros(m), "kappa": np.zeros(m), "vn": full(m, vn), "vt": np.zeros(m),
        "omega": np.zeros(m), "sn": full(m, 0.5), "sv": full(m, 0.05),
    }  # fmt: skip


def llr_floor(llr: np.ndarray) -> float:
    return 0.5 / llr.shape[2]


def observe(buckets, t_us: int, points: np.ndarray, vn: float, llr: np.ndarray, active=None, density=None, target=60):
    m = len(points)
    out = {name: np.zeros(m) for name in ("offset", "sigma", "age", "quality", "window")}
    count = np.zeros(m, np.int64)
    active = np.ones(m, np.uint8) if active is None else active
    observe_stations(
        *buckets, t_us, *station_inputs(points, vn).values(), np.full(m, 4.0), np.full(m, 6.0), active,
        no_rivals(), 0, np.zeros_like(llr), llr, 0.0, llr_floor(llr), 6.0, 0.0, 1.0, target, 8, 0.4, out["offset"],
        out["sigma"], out["age"], count, out["quality"], out["window"], np.zeros(m) if density is None else density,
    )  # fmt: skip
    return out, count


@pytest.mark.parametrize("error_px", [-2.0, 0.0, 1.5])
def test_station_finds_the_bar_beside_the_prediction(bar_scene, sweep_path, error_px: float) -> None:
    scene = bar_scene(sweep_path((0.0, 1.5)))
    buckets = buckets_of(scene, 20)
    y_true = scene.path(20.0)[1]
    points = np.stack([np.array([150.0, 200.0, 250.0]), np.full(3, y_true - error_px)], axis=1)
    correction = scene.correction()
    profile = prior_profiles(np.array([70.0, 120.0, 170.0]), RADIUS_PX, correction.appearance, PARAMS)
    out, count = observe(buckets, 20_000, points, 1.5, log_ratios(profile, 0.5 / profile.shape[2]))
    assert (count > 20).all()
    np.testing.assert_allclose(out["offset"], error_px, atol=0.6)
    assert (out["quality"] > PARAMS.quality_min).all()


def test_events_of_the_wrong_sign_are_no_match(bar_scene, sweep_path) -> None:
    """The same edges with all polarities exchanged are not this DLO (a dark one, moving alike)."""
    scene = bar_scene(sweep_path((0.0, 1.5)))
    buckets = buckets_of(scene, 20, exchanged=True)
    points = np.array([[200.0, scene.path(20.0)[1]]])
    profile = prior_profiles(np.array([120.0]), RADIUS_PX, scene.correction().appearance, PARAMS)
    out, _ = observe(buckets, 20_000, points, 1.5, log_ratios(profile, 0.5 / profile.shape[2]))
    assert out["sigma"][0] == 0.0 or out["quality"][0] < PARAMS.quality_min or abs(out["offset"][0]) > 3.0


def test_inactive_and_silent_stations_say_nothing(bar_scene, sweep_path) -> None:
    scene = bar_scene(sweep_path((0.0, 1.5)))
    buckets = buckets_of(scene, 20)
    points = np.array([[200.0, scene.path(20.0)[1]], [200.0, 250.0]])
    profile = prior_profiles(np.array([120.0, 120.0]), RADIUS_PX, scene.correction().appearance, PARAMS)
    out, count = observe(buckets, 20_000, points, 1.5, log_ratios(profile, 0.1), np.array([0, 1], np.uint8))
    assert (out["sigma"] == 0.0).all()
    assert (count == 0).all()


@pytest.mark.parametrize("theta", [0.0, 0.7, -2.1])
def test_collected_events_equal_a_plain_search(theta: float) -> None:
    rng = np.random.default_rng(3)
    events = np.zeros(12_000, EVENT_DTYPE)
    events["t"] = np.sort(rng.integers(0, 16_000, len(events)))
    events["x"], events["y"] = rng.integers(0, 320, len(events)), rng.integers(0, 240, len(events))
    events["p"] = rng.integers(0, 2, len(events))
    buckets = EventBuckets(SensorGeometry(320, 240))
    buckets.update(events)
    px, py, vn, vt, kappa, omega, latency = 160.3, 118.6, 2.0, -1.0, 2e-3, 0.01, 0.1
    d, age, sign = np.empty(4000, np.float32), np.empty(4000, np.float32), np.empty(4000, np.uint8)
    n = collect_station(
        buckets.rings, buckets.heads, buckets.columns, 16_000, px, py, theta, kappa, vn, vt, omega, 3.0, 20.0, 12.0,
        latency, d, age, sign, np.empty(4000, np.int64),
    )  # fmt: skip
    recent = events[events["t"] > 13_000]
    ages = (16_000 - recent["t"]) * 1e-3
    rx, ry = recent["x"] - px, recent["y"] - py
    tau = rx * np.cos(theta) + ry * np.sin(theta) + vt * ages
    want = -rx * np.sin(theta) + ry * np.cos(theta) + (vn + omega * tau) * (ages + latency) - 0.5 * kappa * tau**2
    keep = (np.abs(want) <= 20.0) & (np.abs(tau) <= 12.0)
    assert n == keep.sum() > 20
    np.testing.assert_allclose(np.sort(d[:n]), np.sort(want[keep]), atol=1e-3)
    # moving towards +n, ON means that luminance falls along the normal: row 1
    assert (sign[:n] == 1).sum() == (recent["p"][keep] == 1).sum()


def test_dense_events_are_looked_at_in_a_part_of_the_station_only(bar_scene, sweep_path) -> None:
    scene = bar_scene(sweep_path((0.0, 3.0)))
    buckets = buckets_of(scene, 20)
    points = np.array([[200.0, scene.path(20.0)[1]]])
    profile = prior_profiles(np.array([120.0]), RADIUS_PX, scene.correction().appearance, PARAMS)
    llr = log_ratios(profile, 0.1)
    first, many = observe(buckets, 20_000, points, 3.0, llr, density=np.zeros(1), target=10)
    second, fewer = observe(buckets, 20_000, points, 3.0, llr, density=np.full(1, 100.0), target=10)
    assert fewer[0] < 0.5 * many[0]
    assert second["offset"][0] == pytest.approx(first["offset"][0], abs=0.5)


@pytest.mark.parametrize("flip", [False, True])
def test_scores_equal_a_plain_sum(flip: bool) -> None:
    rng = np.random.default_rng(2)
    reach, bins = 8, 41
    llr = np.zeros((2, bins + 4 * reach), np.float32)
    llr[:, 2 * reach : -2 * reach] = rng.normal(size=(2, bins))
    d = rng.uniform(-14.0, 14.0, 50).astype(np.float32)
    d[:2] = -90.0, 90.0  # beyond what any shift reaches
    sign = rng.integers(0, 2, 50).astype(np.uint8)
    histogram = np.zeros((2, bins + 2 * reach), np.float32)
    bin_events(d, sign, np.ones(50, np.float32), 50, histogram)
    assert histogram.sum() == 48
    scores = np.zeros(2 * reach + 1, np.float32)
    score_shifts(histogram, np.ascontiguousarray(llr[:, ::-1]), reach, flip, scores)
    middle = 0.5 * (llr.shape[1] - 1)
    for s in (-8, -1, 0, 5, 8):
        at = (d[2:] * 2 + middle + 0.5).astype(int) - s
        assert scores[s + reach] == pytest.approx(llr[1 - sign[2:] if flip else sign[2:], at].sum(), abs=1e-3)


@pytest.mark.parametrize(
    ("lower", "upper", "one_sided"), [(20, 20, False), (20, 7, False), (0, 30, True), (30, 2, True)]
)
def test_one_edge_alone_is_a_line_that_passes(lower: int, upper: int, one_sided: bool) -> None:
    at = 5
    profile = prior_profiles(np.array([120.0]), RADIUS_PX, None, PARAMS)[0]
    bins = profile.shape[1]
    histogram = np.zeros((2, bins + 12), np.float32)
    for edge, count in ((-RADIUS_PX, lower), (RADIUS_PX, upper)):
        histogram[0, at + int((bins - 1) / 2 + 2 * edge)] = count
    assert is_one_sided(histogram, at, profile) == one_sided


def test_a_silhouette_that_shows_no_contrast_is_not_missed() -> None:
    profile = np.zeros((2, 61), np.float32)
    profile[0, 46], profile[1, 14] = 0.95, 0.05
    histogram = np.zeros((2, 61), np.float32)
    histogram[0, 46] = 40.0
    assert not is_one_sided(histogram, 0, profile)


def test_profile_learns_an_edge_that_the_frame_did_not_show(bar_scene, sweep_path) -> None:
    scene = bar_scene(sweep_path((0.0, 1.5)))
    buckets = buckets_of(scene, 20)
    points = np.array([[200.0, scene.path(20.0)[1]]])
    prior = prior_profiles(np.array([120.0]), 5.0, None, PARAMS)
    profile, llr = prior.copy(), log_ratios(prior, 0.01)
    inputs = station_inputs(points, 1.5)
    del inputs["sv"]
    before = profile[0, :, 2 * 15 + 16].sum()
    for _ in range(40):
        learn_profiles(
            *buckets, 20_000, *inputs.values(), np.full(1, 3.0), np.ones(1, np.uint8), no_rivals(), 0, np.zeros(1), 0,
            1, 0.3, 6.0, 0.0, 0.1, 0.0, 0.01, prior, profile, llr,
        )  # fmt: skip
    bins = profile.shape[2]
    edge = int((bins - 1) / 2 + 2 * 8)
    assert profile[0, 1, edge - 1 : edge + 2].sum() > before + 0.2
    assert profile.sum() == pytest.approx(1.0, abs=0.05)


def test_what_is_covered_in_the_frame_is_not_visible_at_the_start(bar_scene, sweep_path) -> None:
    appearance = bar_scene(sweep_path()).correction().appearance
    strip = appearance.strip.copy()
    strip[60:80] = 0.0
    covered = type(appearance)(strip, appearance.known, appearance.s0_px)
    s = np.array([0.0, 60.0, 200.0])
    assert visible_at_start(s, RADIUS_PX, covered).tolist() == [True, False, True]
