"""Joint association: events belong to the DLO whose edge, polarity and motion explain them, and to no two of them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import pytest

from motiondlo.events.bucket_kernels import TIME_SHIFT, X_SHIFT, Y_SHIFT
from motiondlo.events.buckets import EventBuckets
from motiondlo.events.types import EVENT_DTYPE, SensorGeometry
from motiondlo.tracking.inextensible.end_kernels import collect_tip
from motiondlo.tracking.inextensible.params import InextensibleParams
from motiondlo.tracking.inextensible.rival_kernels import (
    LEAST_RATE,
    OWN_FLOOR,
    blocks_in_reach,
    lay_out,
    rows_near,
    share_events,
)
from motiondlo.tracking.inextensible.rivals import Rivals, make_rivals
from motiondlo.tracking.inextensible.tracker import InextensibleTracker

BINS = 61
LATENCY_MS = 0.1


def edges(at_px: float) -> np.ndarray:
    """A profile (2, BINS) with one edge of rising luminance at -at_px and one of falling at +at_px."""
    d = (np.arange(BINS) - (BINS - 1) / 2) / 2.0
    rows = np.stack([np.exp(-0.5 * (d + at_px) ** 2), np.exp(-0.5 * (d - at_px) ** 2)])
    return np.asarray(rows / rows.sum(), np.float32)


def one_rival(y: float, vn: float, rate: float, at_us: int = 10_000, theta: float = 0.0) -> Rivals:
    """A block of one station at (100, y) beside an empty block."""
    rivals = make_rivals([1, 1], [BINS, BINS])
    lay_out(
        rivals, 1, at_us, np.array([[100.0, y]]), np.full(1, theta), np.zeros(1), np.full(1, vn), np.zeros(1),
        np.zeros(1), np.full(1, 0.4), np.full(1, rate), np.ones(1, np.uint8), True, 12.0, edges(8.0)[None],
    )  # fmt: skip
    return rivals


def word(t_us: int, x: int, y: int, on: bool) -> int:
    return t_us << TIME_SHIFT | y << Y_SHIFT | x << X_SHIFT | int(on)


def shares(rivals: Rivals, words: list[int], d: list[float], sign: list[int], rate: float = 1.0) -> np.ndarray:
    """Of events for a station with edges at 8 px."""
    n = len(words)
    out = np.zeros(n, np.float32)
    total = share_events(
        rivals, np.array([1]), 1, 10_000, LATENCY_MS, edges(8.0), rate, 0.4, False, np.array(words),
        np.array(d, np.float32), np.array(sign, np.uint8), n, 1, out,
    )  # fmt: skip
    assert total == pytest.approx(out.sum(), rel=1e-5)
    return out


def test_an_event_on_the_rivals_edge_is_the_rivals() -> None:
    # It moves by 2 px/ms downwards: its lower edge at y = 108 makes OFF events if it is bright (row 1).
    rivals = one_rival(100.0, 2.0, 5.0)
    on_edge = word(9_000, 100, 106, True)
    away = word(9_000, 100, 130, True)
    share = shares(rivals, [on_edge, away], [0.0, 0.0], [0, 0])
    assert share[0] < 0.1
    assert share[1] == 1.0


@pytest.mark.parametrize("wrong", ["polarity", "velocity", "place"])
def test_what_contradicts_the_rival_is_left_to_the_station(wrong: str) -> None:
    rivals = one_rival(100.0, 2.0, 5.0)
    event = {
        "polarity": word(9_000, 100, 106, False),  # the wrong polarity on its edge
        "velocity": word(6_000, 100, 106, True),  # at the edge's place, but 4 ms ago: it was 8 px above then
        "place": word(9_000, 100, 112, True),
    }[wrong]
    assert shares(rivals, [event], [-8.0], [0])[0] > 0.9


def test_shares_of_two_dlos_on_the_same_edge_add_up_to_one() -> None:
    rate, other_rate = 2.0, 6.0
    rivals = one_rival(100.0, 2.0, other_rate)
    event = word(10_000, 100, 108, True)
    # For the station the event lies on its own lower edge, a bin's width off where the rival has its own.
    mine = shares(rivals, [event], [8.2], [1], rate)[0]
    assert mine == pytest.approx(rate / (rate + other_rate), abs=0.05)


def test_a_slow_station_claims_its_edges_as_if_it_made_some_events() -> None:
    rivals = one_rival(100.0, 2.0, 50.0)
    share = shares(rivals, [word(10_000, 100, 108, True)], [8.0], [1], rate=0.0)[0]
    assert 0.5 * LEAST_RATE < share < 2.0 * LEAST_RATE


def test_shares_equal_a_plain_computation() -> None:
    rng = np.random.default_rng(5)
    theta = 0.4
    rivals = one_rival(101.3, 1.5, 3.0, at_us=9_400, theta=theta)
    t, x, y = rng.integers(7_000, 10_000, 300), rng.integers(80, 120, 300), rng.integers(80, 125, 300)
    on, sign = rng.integers(0, 2, 300), rng.integers(0, 2, 300)
    d = rng.uniform(-16.0, 16.0, 300).astype(np.float32)
    got = shares(
        rivals, [word(*row) for row in zip(t.tolist(), x.tolist(), y.tolist(), on.tolist(), strict=True)],
        d.tolist(), sign.tolist(),
    )  # fmt: skip
    profile = edges(8.0)

    def largest(row: int, at: int) -> float:
        return float(profile[row, max(at - 1, 0) : at + 2].max()) if -1 <= at <= BINS else 0.0

    for k in range(300):
        age = (9_400 - t[k]) * 1e-3
        rx, ry = x[k] - 100.0, y[k] - 101.3
        tau = rx * np.cos(theta) + ry * np.sin(theta)
        e = -rx * np.sin(theta) + ry * np.cos(theta) + 1.5 * (age + LATENCY_MS)
        at = int(np.floor(e * 2 + BINS / 2))
        other = 3.0 * largest(int(on[k] == 1), at) if abs(tau) <= 12.0 and 0 <= at < BINS else 0.0
        mine = largest(sign[k], int(np.floor(d[k] * 2 + BINS / 2))) + OWN_FLOOR * 0.5 / BINS
        assert got[k] == pytest.approx(mine / (mine + other), rel=1e-3)


def test_only_what_lies_near_is_considered() -> None:
    rivals = one_rival(100.0, 2.0, 5.0)
    out, near = np.zeros(2, np.int64), np.zeros(4, np.int64)
    active = np.ones(1, np.uint8)
    assert blocks_in_reach(rivals, 0, np.array([[100.0, 140.0]]), active, 60.0, out) == 1
    assert blocks_in_reach(rivals, 0, np.array([[100.0, 240.0]]), active, 60.0, out) == 0
    assert blocks_in_reach(rivals, 1, np.array([[100.0, 140.0]]), active, 60.0, out) == 0, "its own rows"
    out[0] = 1
    assert rows_near(rivals, out, 1, 100.0, 120.0, 0.0, 2.0, 0.0, 3.0, 12.0, 20.0, near) == 1
    assert rows_near(rivals, out, 1, 100.0, 160.0, 0.0, 2.0, 0.0, 3.0, 12.0, 20.0, near) == 0
    assert rows_near(rivals, out, 1, 130.0, 120.0, 0.0, 2.0, 0.0, 3.0, 12.0, 20.0, near) == 0, "beside its station"
    assert rows_near(rivals, out, 1, 100.0, 160.0, 0.0, -10.0, 0.0, 3.0, 12.0, 20.0, near) == 1, (
        "they moved apart meanwhile"
    )


@pytest.mark.parametrize("busy", [False, True])
def test_a_tip_leaves_out_what_a_rival_explains_better(busy: bool) -> None:
    rivals = one_rival(100.0, 2.0, 5.0)
    events = np.zeros(2, EVENT_DTYPE)
    events["t"], events["x"], events["y"], events["p"] = 9_000, (100, 104), (106, 118), 1
    buckets = EventBuckets(SensorGeometry(320, 240))
    buckets.update(events)
    event_source = (buckets.rings, buckets.heads, buckets.columns)
    intensity = 10.0 if busy else 0.01
    histogram = np.zeros(81)
    n, _ = collect_tip(
        *event_source, 10_000, 95.0, 112.0, 1.0, 0.0, 0.0, 0.0, 4.0, 0.0, 12.0, rivals, 0, intensity, histogram
    )  # fmt: skip
    assert n == (2 if busy else 1)


def bars(bar_scene: type, path_a: Callable, path_b: Callable) -> object:
    """Scene of two bars; the second lies on the first, and is brighter."""

    @dataclass
    class TwoBars(bar_scene):  # type: ignore[misc]
        def mask(self, t_ms: float) -> np.ndarray:
            upper = replace(bar_scene(path_b), geometry=self.geometry).mask(t_ms)
            return super().mask(t_ms) | upper

    return TwoBars(path_a, geometry=SensorGeometry(420, 300))


def test_a_resting_dlo_is_not_carried_along_by_one_that_passes_over_it(bar_scene) -> None:
    def passing(t_ms: float) -> tuple[float, float]:
        return 90.0, 60.0 + 1.5 * t_ms

    scene = bars(bar_scene, lambda t_ms: (80.0, 120.0), passing)
    tracker = InextensibleTracker(InextensibleParams(), scene.geometry)
    tracker.correct(scene.correction())
    tracker.correct(bar_scene(passing).correction(seq=1, dlo_id=2))
    for k in range(80):
        update = tracker.update(scene.batch(k))
        rests, passes = update.tracks
        assert np.abs(rests.nodes[5:-5, 1] - 120.0).max() < 2.0, f"at {k + 1} ms"
    assert np.abs(passes.nodes[5:-5, 1] - passing(80.0)[1]).max() < 2.0
