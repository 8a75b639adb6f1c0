"""Which measurements a station gives, where a DLO ends, and who is awake."""

from __future__ import annotations

import numpy as np
import pytest

from motiondlo.tracking.inextensible.near_kernels import count_near, mark_tiles
from motiondlo.tracking.inextensible.row_kernels import end_row, find_end, station_rows, update_support
from motiondlo.tracking.inextensible.step_kernels import (
    fast_speed,
    fit_summary,
    largest_innovation,
    prepare_stations,
    remember_rates,
)

M, N = 7, 5


def rows_for(vn, matched, alive=None, count=None, offset_px=0.4):
    """Rows of M stations with the given normal rates; ``matched`` marks those with a good match."""
    matched = np.asarray(matched, float)
    count = np.where(matched > 0, 50, 0) if count is None else np.asarray(count)
    alive = np.ones(M) if alive is None else np.asarray(alive, float)
    h, z, w, robust = np.full((30, 2 * N + 5), np.nan), np.zeros(30), np.zeros(30), np.zeros(30, np.uint8)
    good, covered, nis = np.zeros(M, np.uint8), np.zeros(M, np.uint8), np.zeros(M)
    rows, seen, could = station_rows(
        N, 1.0, np.ones((M, N)), np.zeros(M), np.asarray(vn, float), np.full(M, 0.5), matched * offset_px,
        matched * 0.3, matched * 1.0, count, matched * 2.0, np.full(M, 2.0), np.ones(M, np.uint8), alive, 0.6, 0.05,
        1.0, 0.4, 8, 0.3, 0.5, h, z, w, robust, good, covered, nis,
    )  # fmt: skip
    return rows, seen, could, h, z, w, good


def test_a_reused_window_is_not_new_information() -> None:
    *_, w, _ = rows_for(np.full(M, 2.0), np.ones(M))
    once = 1.0 / (0.6**2 + 4 * 0.3**2 + 0.05**2)
    assert w[0] == pytest.approx(once / 2.0)


def test_mean_age_binds_the_rate_as_well() -> None:
    *_, h, _, _, _ = rows_for(np.full(M, 2.0), np.ones(M))
    np.testing.assert_allclose(h[0, :N], 1.0)
    np.testing.assert_allclose(h[0, N : 2 * N], -1.0)


def test_silence_is_rest_where_the_dlo_is_in_view() -> None:
    rows, seen, could, h, z, _, _ = rows_for(np.full(M, 0.2), np.zeros(M), alive=[1, 1, 1, 0, 0, 1, 1])
    assert (rows, seen, could) == (5, 0, M)
    np.testing.assert_allclose(z[:5], -0.2)
    np.testing.assert_allclose(h[0, :N], 0.0)


def test_silence_between_moving_parts_is_a_cover() -> None:
    rows, seen, *_ = rows_for([3, 3, 0.2, 0.1, 0.2, 3, 3], [1, 1, 0, 0, 0, 1, 1])
    assert rows == seen == 4


def test_what_is_dragged_past_a_cover_is_no_rest_though_the_rates_lag() -> None:
    """At the onset only the offsets show that both neighbours move."""
    rows, seen, *_ = rows_for([0.1] * M, [1, 1, 0, 0, 0, 1, 1], offset_px=1.5)
    assert rows == seen == 4


def test_stray_events_where_nothing_was_seen_before_are_no_match() -> None:
    alive = [1, 1, 1, 1, 0, 0, 0]
    *_, good = rows_for(np.full(M, 2.0), np.ones(M), alive, count=[90, 90, 90, 90, 90, 12, 12])
    assert good.tolist() == [1, 1, 1, 1, 1, 0, 0]


@pytest.mark.parametrize(("axis", "turn", "constant"), [((0.6, 0.8), 0.0, 3), ((0.0, 0.0), 1.0, -1)])
def test_row_of_an_end(axis, turn: float, constant: int) -> None:
    rng = np.random.default_rng(8)
    jacobian, angle_row = rng.normal(size=(2, N)), rng.normal(size=N - 2)
    h = np.full((3, 2 * N + 5), np.nan)
    end_row(1, jacobian, angle_row, *axis, turn, 1.1, -0.7, constant, 9.0, h)
    base = np.array(axis) @ jacobian + turn * np.concatenate([[0.0, 0.0], angle_row])
    want = np.concatenate([1.1 * base, -0.7 * base, np.zeros(5)])
    if constant >= 0:
        want[2 * N + constant] = 9.0
    np.testing.assert_allclose(h[1], want)
    assert np.isnan(h[[0, 2]]).all()


def ended_at(absent_from: int, x0: float = 100.0, ms: float = 6.0):
    p = np.stack([x0 + 12.0 * np.arange(M), np.full(M, 100.0)], axis=1)
    good = (np.arange(M) < absent_from).astype(np.uint8)
    absent = np.where(good, 0.0, ms)
    out = np.zeros(2)
    found = find_end(1, 4.0, 12.0, 640, 480, p, 12.0 * np.arange(M), good, absent, out)
    return found, out


def test_an_end_that_came_into_view_is_found() -> None:
    found, out = ended_at(4)
    assert found == 1
    np.testing.assert_allclose(out, [36.0, 48.0])


def test_no_end_is_found_outside_the_image_or_too_soon() -> None:
    assert ended_at(4, x0=590.0)[0] == 0
    assert ended_at(4, ms=1.0)[0] == 0
    assert ended_at(6)[0] == 0  # one absent station may be a print


def test_support_fades_only_for_what_should_move_in_view() -> None:
    alive, support, absent = np.ones(3), np.ones(3), np.zeros(3)
    active = np.array([1, 1, 0], np.uint8)
    seen_ms, past, filled = np.zeros(3), np.zeros((4, 3)), 0
    for _ in range(10):
        filled = update_support(
            1.0, active, np.zeros(3, np.uint8), np.zeros(3, np.uint8), np.zeros(3, np.int64),
            np.array([2.0, 0.1, 2.0]), 8, alive, support, absent, seen_ms, past, filled,
        )  # fmt: skip
    assert filled == 4
    np.testing.assert_allclose(past[3], [2.0, 0.1, 2.0])
    assert not seen_ms.any()
    assert support[0] == pytest.approx(0.5)
    assert absent[0] == pytest.approx(10.0)
    assert support[1] == 1.0
    assert alive[2] < 0.2


def test_windows_follow_acceleration_and_travel() -> None:
    m = 9
    out = {name: np.zeros(m) for name in ("accel", "window", "band")}
    active = np.zeros(m, np.uint8)
    p = np.stack([np.linspace(-20.0, 100.0, m), np.full(m, 50.0)], axis=1)
    past = np.zeros((4, m))
    args = (p, np.linspace(0, 96, m))

    def prepared(vn: float, filled: int) -> float:
        prepare_stations(
            1.0, *args, np.full(m, vn), past, filled, np.full(m, 0.5), 6.0, 90.0, 640, 480, 3.0, 8.0, 1.0, 8.0, 5.0,
            2.0, 22.0, active, out["accel"], out["window"], out["band"],
        )  # fmt: skip
        return float(out["window"][4])

    assert prepared(0.1, 0) == 8.0
    assert prepared(2.0, 0) == pytest.approx(4.0)
    assert prepared(3.0, 4) == pytest.approx(2.0)  # 0.75 px/ms^2
    assert active.tolist() == [0, 0, 1, 1, 1, 1, 1, 1, 0]


def test_summaries() -> None:
    assert fast_speed(np.arange(10.0), np.zeros(10)) == 9.0
    good = np.array([1, 0, 1, 1], np.uint8)
    seen, median, rms = fit_summary(good, np.array([1.0, 50.0, 2.0, 3.0]), np.array([1.0, 9.0, -1.0, 1.0]))
    assert (seen, median, rms) == (3, 2.0, 1.0)
    past = np.zeros((4, 2))
    filled = 0
    for k in range(6):
        filled = remember_rates(np.full(2, float(k)), past, filled)
    assert filled == 4
    np.testing.assert_allclose(past[:, 0], [2, 3, 4, 5])
    h = np.array([[1.0, 0.0], [0.0, 1.0]])
    assert largest_innovation(np.eye(2) * 3.0, h, np.array([9.0, 4.0]), np.ones(2), 1, 2) == pytest.approx(4.0)


def test_events_are_counted_near_every_dlo() -> None:
    tiles = np.zeros((20, 20), np.uint32)
    mark_tiles(np.array([[100.0, 100.0]]), 10.0, 3, 320, 320, tiles)
    mark_tiles(np.array([[104.0, 100.0], [-500.0, 0.0]]), 10.0, 31, 320, 320, tiles)
    counts = np.zeros(32, np.int64)
    hits = np.zeros((20, 20), np.int32)
    hits[101 >> 4, 100 >> 4] = hits[10 >> 4, 300 >> 4] = 1
    count_near(hits, tiles, counts)
    assert counts[3] == counts[31] == 1
    assert counts.sum() == 2
