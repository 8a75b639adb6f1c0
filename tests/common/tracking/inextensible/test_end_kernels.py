"""A gripper's patch and a tip's profile are found where they are."""

from __future__ import annotations

import numpy as np
import pytest

from motiondlo.events.buckets import EventBuckets
from motiondlo.events.types import EVENT_DTYPE, SensorGeometry
from motiondlo.tracking.inextensible.end_kernels import (
    collect_patch,
    collect_tip,
    learn_patch,
    match_patch,
    match_tip,
    shortest_window,
)
from motiondlo.tracking.inextensible.ends import tip_tables
from motiondlo.tracking.inextensible.rivals import no_rivals

A_MIN, B_MAX = -20.0, 40.0


def jaws(count: int = 400) -> tuple[np.ndarray, np.ndarray]:
    """Events of an L-shaped piece in the patch's frame."""
    rng = np.random.default_rng(1)
    along = np.where(rng.random(count) < 0.5, rng.uniform(5.0, 45.0, count), 25.0)
    across = np.where(along == 25.0, rng.uniform(-25.0, 25.0, count), 12.0)
    return (along + rng.normal(0, 0.4, count)).astype(np.float32), (across + rng.normal(0, 0.4, count)).astype(
        np.float32
    )


def learned_jaws() -> tuple[np.ndarray, np.ndarray]:
    template = np.full((81, 81), 1.0 / 81**2, np.float32)
    log_template = np.zeros_like(template)
    a, b = jaws()
    for _ in range(5):
        learn_patch(template, log_template, a, b, len(a), A_MIN, B_MAX, 0.5, 0.3)
    return template, log_template


@pytest.mark.parametrize(("shift_a", "shift_b"), [(0.0, 0.0), (3.0, -2.0), (-4.0, 5.0)])
def test_patch_is_found_where_it_went(shift_a: float, shift_b: float) -> None:
    _, log_template = learned_jaws()
    a, b = jaws()
    out = np.zeros(7)
    match_patch(log_template, a + np.float32(shift_a), b + np.float32(shift_b), len(a), A_MIN, B_MAX, 6, 300, out)
    assert out[0] == pytest.approx(shift_a, abs=0.6)
    assert out[1] == pytest.approx(shift_b, abs=0.6)
    assert out[3] > 0.5


def test_other_events_do_not_fit_the_patch() -> None:
    _, log_template = learned_jaws()
    rng = np.random.default_rng(9)
    a, b = rng.uniform(-20, 60, 400).astype(np.float32), rng.uniform(-40, 40, 400).astype(np.float32)
    out = np.zeros(7)
    match_patch(log_template, a, b, 400, A_MIN, B_MAX, 6, 300, out)
    assert out[3] < 0.1


def buckets_with(*events: tuple[int, int, int, int]) -> tuple[np.ndarray, np.ndarray, int]:
    """Events (t_us, x, y, polarity) in buckets of a 240x240 sensor."""
    array = np.zeros(len(events), EVENT_DTYPE)
    for name, values in zip(("t", "x", "y", "p"), zip(*events, strict=True), strict=True):
        array[name] = values
    buckets = EventBuckets(SensorGeometry(240, 240))
    buckets.update(array)
    return buckets.rings, buckets.heads, buckets.columns


def test_patch_is_collected_in_its_own_frame_and_without_the_dlo() -> None:
    buckets = buckets_with(
        (9_000, 70, 100, 1),  # 30 px outward of (100, 100) along -x, 1 ms old
        (9_500, 115, 100, 0),  # on the DLO: left out
        (9_500, 115, 120, 0),  # beside it
    )
    for likely_ms in (4.0, 0.6):
        buffers = [np.zeros(50, np.float32) for _ in range(3)]
        n, age, window = collect_patch(
            *buckets, 10_000, 100.0, 100.0, -1.0, 0.0, 2.0, 0.0, 0.0, 1.0, 4.0, likely_ms, 300, 0.0, A_MIN, 60.0, B_MAX,
            12.0, *buffers,
        )  # fmt: skip
        found = sorted(zip(buffers[0][:n].tolist(), buffers[1][:n].tolist(), strict=True))
        assert found == [pytest.approx((-16.0, -20.0)), pytest.approx((28.0, 0.0))]
        assert age == pytest.approx(0.75)
        assert window == 4.0


def test_window_is_as_short_as_the_events_allow() -> None:
    ages = np.zeros(64, np.int64)
    ages[:16] = 50  # 200 events a ms
    assert shortest_window(ages, 300, 1.0, 8.0) == 1.5
    assert shortest_window(ages, 10, 1.0, 8.0) == 1.0
    assert shortest_window(ages, 10_000, 1.0, 8.0) == 8.0


def tip_histogram(shift: int, sides: float, face: float) -> np.ndarray:
    """(81,) events per pixel along a tip that lies ``shift`` px outward of the middle."""
    at = np.arange(-40, 41)
    histogram = np.where(at <= shift, sides, 0.0)
    histogram[at == shift] += face
    return histogram


@pytest.mark.parametrize("shift", [-7, 0, 5])
@pytest.mark.parametrize(("sides", "face"), [(8.0, 0.0), (6.0, 40.0), (1.0, 90.0)])
def test_tip_is_found_whichever_way_it_moves(shift: int, sides: float, face: float) -> None:
    """Moving across, its silhouettes end there; moving along itself, its face makes most events."""
    out = np.zeros(2)
    match_tip(tip_histogram(shift, sides, face), *tip_tables(), 14, out)
    assert out[0] == pytest.approx(shift, abs=0.3)
    assert 0.0 < out[1] < 1.0


def test_tip_is_found_where_something_else_moves_beyond_it() -> None:
    rng = np.random.default_rng(3)
    histogram = tip_histogram(4, 8.0, 0.0) + rng.poisson(3.0, 81)
    out = np.zeros(2)
    match_tip(histogram, *tip_tables(), 14, out)
    assert out[0] == pytest.approx(4.0, abs=1.0)
    assert out[1] > 0.0


def test_tip_of_few_events_is_less_sure() -> None:
    many, few = np.zeros(2), np.zeros(2)
    match_tip(tip_histogram(2, 6.0, 40.0), *tip_tables(), 14, many)
    match_tip(tip_histogram(2, 1.0, 6.0), *tip_tables(), 14, few)
    assert few[1] > 1.5 * many[1]


def test_no_step_in_reach_is_no_tip() -> None:
    out = np.zeros(2)
    match_tip(np.full(81, 8.0), *tip_tables(), 14, out)
    assert out[1] == 0.0


def test_tip_events_are_moved_with_the_tip() -> None:
    buckets = buckets_with(
        (8_000, 90, 50, 0),  # two ms ago, the tip has moved by 6 px since
        (9_500, 96, 80, 0),  # too far across
    )
    histogram = np.zeros(81)
    n, age = collect_tip(
        *buckets, 10_000, 100.0, 50.0, 1.0, 0.0, 3.0, 0.0, 4.0, 0.0, 10.0, no_rivals(), 0, 0.0, histogram
    )
    assert n == 1
    assert histogram[40 - 4] == 1.0
    assert age == pytest.approx(2.0)


@pytest.mark.parametrize("angle_rad", [0.0, 0.6, 1.57, -2.4])
def test_no_event_of_a_turned_and_moving_end_is_left_out(angle_rad: float) -> None:
    """Only the tiles around it are looked at: they hold all that a search of the whole sensor finds."""
    rng = np.random.default_rng(4)
    t, p, y, x = np.sort(rng.integers(0, 10_000, 30_000)), *rng.integers(0, (2, 240, 240), (30_000, 3)).T
    buckets = buckets_with(*zip(t, x, y, p, strict=True))
    ex, ey = np.cos(angle_rad), np.sin(angle_rad)
    (vx, vy), omega, ox, oy, latency = (2.0, -1.5), 0.01, 120.4, 118.7, 0.1
    y, x, t = y[t > 6_000], x[t > 6_000], t[t > 6_000]
    age = (10_000 - t) * 1e-3 + latency
    rx, ry = x - ox, y - oy
    dx, dy = rx + (vx - omega * ry) * age, ry + (vy + omega * rx) * age
    a, b = ex * dx + ey * dy, -ey * dx + ex * dy
    within = (a >= A_MIN) & (a < 60.0) & (np.abs(b) < B_MAX) & ~((a < 0.0) & (np.abs(b) < 12.0))
    buffers = [np.zeros(8000, np.float32) for _ in range(3)]
    n, *_ = collect_patch(
        *buckets, 10_000, ox, oy, ex, ey, vx, vy, omega, 1.0, 4.0, 4.0, 10**6, latency, A_MIN, 60.0, B_MAX, 12.0,
        *buffers,
    )  # fmt: skip
    assert n == within.sum()
    np.testing.assert_allclose(np.sort(buffers[0][:n]), np.sort(a[within]), atol=1e-4)
    dx, dy = rx + vx * age, ry + vy * age
    along, across = ex * dx + ey * dy, -ey * dx + ex * dy
    histogram = np.zeros(81)
    n, _ = collect_tip(*buckets, 10_000, ox, oy, ex, ey, vx, vy, 4.0, latency, 10.0, no_rivals(), 0, 0.0, histogram)
    want = np.bincount(np.floor(along[(np.abs(across) <= 10.0) & (np.abs(along) < 60.0)] + 60.5).astype(int))
    np.testing.assert_array_equal(histogram, want[20:101])
    assert n == histogram.sum()
