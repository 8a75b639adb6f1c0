"""Profiles: events found, moved on, matched, learned; against plain numpy."""

from __future__ import annotations

import numpy as np
import pytest

from motiondlo.tracking.chain import profile_kernels
from motiondlo.tracking.chain.templates import edge_density, profile_bins

RADIUS = 8.0
HALF = profile_bins(RADIUS)
BINS = 2 * HALF + 1
FLOOR = 0.5 / BINS


def moving_edges(centre: float, velocity: float, t_us: int = 20_000, age_ms: float = 6.0) -> np.ndarray:
    """Surface of a bright bar along x whose middle is at y = ``centre`` now; velocity px/ms along y."""
    last = np.full((2, 120, 200), -(10**12), np.int64)
    ages = np.arange(age_ms, 0.0, -0.05)
    for age in ages:
        y = centre - velocity * age
        for edge, leading in ((RADIUS, velocity > 0), (-RADIUS, velocity < 0)):
            row = round(y + edge)
            last[1 if leading else 0, row, :] = t_us - round(age * 1000)
    return last


def match(last: np.ndarray, predicted: float, velocity: float, table: np.ndarray, band: float = 10.0) -> np.ndarray:
    g = np.zeros((1, 10))
    g[0] = [100.0, predicted, 1.0, 0.0, 0.0, velocity, velocity, 0.0, 0.0, 48.0]
    out = np.zeros((1, 8))
    hist = np.zeros((1, 2, BINS + 200), np.float32)
    profile_kernels.match_profiles(
        last, 20_000, 0.0, g, np.array([0.1]), np.zeros(1), np.array([band]), np.ones(1, np.bool_), table, 3, 3.0,
        4.0, 1.0, 8.0, 3.0, 48, 8, 0.4, hist, out, np.zeros((2, 200), np.float32),
        np.zeros(profile_kernels.MAX_EVENTS, np.int64), np.zeros(profile_kernels.MAX_EVENTS),
        np.zeros(profile_kernels.MAX_EVENTS, np.int64),
    )  # fmt: skip
    return np.concatenate([out[0], [hist.sum()]])


def table_for(rises: tuple[float, float]) -> np.ndarray:
    density = edge_density(RADIUS, HALF, np.array([rises]))
    return np.ascontiguousarray(np.log((density + FLOOR) / (2 * FLOOR)), dtype=np.float32)


@pytest.mark.parametrize("velocity", [2.0, -2.0, 5.0])
@pytest.mark.parametrize("offset", [0.0, 3.0, -4.5])
def test_offset_of_a_moving_bar_is_found(velocity: float, offset: float) -> None:
    out = match(moving_edges(60.0 + offset, velocity), 60.0, velocity, table_for((1.0, -1.0)))
    assert out[1] > 0
    assert out[0] == pytest.approx(offset, abs=0.6)
    assert out[2] > 0.5


def test_wrong_contrast_does_not_match() -> None:
    out = match(moving_edges(60.0, 3.0), 60.0, 3.0, table_for((-1.0, 1.0)))
    assert out[1] == 0.0 or out[2] < 0.25


def test_silence_is_reported_as_silence() -> None:
    out = match(np.full((2, 120, 200), -(10**12), np.int64), 60.0, 1.0, table_for((1.0, -1.0)))
    assert out[3] == 0
    assert out[1] == 0.0


def test_only_the_newest_events_are_used() -> None:
    slow = match(moving_edges(60.0, 1.0), 60.0, 1.0, table_for((1.0, -1.0)))
    fast = match(moving_edges(60.0, 6.0), 60.0, 6.0, table_for((1.0, -1.0)))
    assert fast[5] <= 1.0 + 1e-9
    assert slow[5] > 2.0
    assert slow[8] == slow[3]


def test_score_is_the_sum_of_log_ratios() -> None:
    """Numpy twin: of all shifts, the one with the largest summed log-likelihood ratio less the pull to the middle."""
    rng = np.random.default_rng(2)
    last = np.full((2, 120, 200), -(10**12), np.int64)
    rows = rng.integers(30, 90, 60)
    last[rng.integers(0, 2, 60), rows, rng.integers(91, 109, 60)] = 19_500
    table = table_for((1.0, -1.0))
    out = match(last, 60.0, 1.0, table)
    sampled = []
    for q in range(-3, 4):
        column = 100 + 3 * q
        for p in range(2):
            for y in np.flatnonzero(last[p, :, column] > 0):
                d = (y - 60.0) + 1.0 * 0.5
                if abs(d) <= HALF * 0.5 + 10.0:
                    sampled.append((0 if p == 0 else 1, int(np.floor(d * 2 + 0.5))))
    scores = []
    for k in range(-20, 21):
        total = -2.0 * (k / 20) ** 2
        for sign, b in sampled:
            j = b - k + HALF
            total += table[0, sign, j] if 0 <= j < BINS else table[0, sign, 0]
        scores.append(total)
    best = int(np.argmax(scores)) - 20
    if out[1] > 0:
        assert out[0] == pytest.approx(0.5 * best, abs=1.01)
    else:
        assert max(scores) <= 0.0 or abs(best) > 17 or out[7] < 8


def test_learning_moves_towards_what_was_seen_and_keeps_the_anchor() -> None:
    anchor = edge_density(RADIUS, HALF, np.array([[1.0, -1.0]])).astype(np.float32)
    density, table = anchor.copy(), table_for((1.0, -1.0))
    hist = np.zeros((1, 2, BINS + 40), np.float32)
    middle = (hist.shape[2] - 1) // 2
    hist[0, 0, middle + 6] = 80.0
    args = (np.zeros(1), np.ones(1, np.bool_), 0.5, density, anchor, 0.3, FLOOR, table)
    profile_kernels.learn_profiles(hist, *args)
    assert density.sum() == pytest.approx(1.0, abs=1e-4)
    assert density[0, 0, HALF + 6] > anchor[0, 0, HALF + 6] + 0.1
    mixed = 0.7 * density + 0.3 * anchor
    np.testing.assert_allclose(table, np.log((mixed + FLOOR) / (2 * FLOOR)), atol=1e-5)


def test_activity_counts_new_events_on_the_normals_only() -> None:
    last = np.full((2, 120, 200), -(10**12), np.int64)
    last[0, 55, 100] = 19_000
    last[1, 62, 100] = 19_000
    last[1, 62, 120] = 19_000
    last[0, 64, 100] = 10_000
    g = np.zeros((1, 10))
    g[0, :4] = [100.0, 60.0, 1.0, 0.0]
    everywhere = np.ones(1, np.bool_)
    assert profile_kernels.activity(last, 20_000, 18_000, g, 12.0, everywhere) == 2
    assert profile_kernels.activity(last, 20_000, 18_000, g, 12.0, ~everywhere) == 0
