"""Patches: events in the moving frame, tables by direction, exhaustive match, where events end."""

from __future__ import annotations

import numpy as np
import pytest

from motiondlo.tracking.chain import patch_kernels

A, D, PAD = 41, 31, 12
A0, DM = 2.0, 15.0


def gradients(seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """Gradients of some dark dots on grey."""
    rng = np.random.default_rng(seed)
    a, d = np.mgrid[0:A, 0:D].astype(float)
    image = np.zeros((A, D))
    for _ in range(7):
        ca, cd = rng.uniform(5, A - 5), rng.uniform(4, D - 4)
        image -= np.exp(-0.5 * (((a - ca) ** 2 + (d - cd) ** 2) / 4.0))
    return np.gradient(image, axis=0).astype(np.float32), np.gradient(image, axis=1).astype(np.float32)


def events_of(ga: np.ndarray, gd: np.ndarray, va: float, vd: float, shift: tuple[float, float]):
    change = -(va * ga + vd * gd)
    a, d = np.nonzero(np.abs(change) > 0.08)
    polarity = (change[a, d] > 0).astype(np.int64)
    return a + A0 + shift[0], d - DM + shift[1], polarity


def table_of(ga: np.ndarray, gd: np.ndarray, va: float, vd: float) -> np.ndarray:
    table = np.zeros((2, A + 2 * PAD, D + 2 * PAD), np.float32)
    patch_kernels.build_table(ga, gd, va, vd, PAD, np.zeros((2, A, D), np.float32), table)
    return table


@pytest.mark.parametrize("shift", [(0.0, 0.0), (4.0, -3.0), (-6.0, 5.0)])
def test_shift_of_a_patch_is_found(shift: tuple[float, float]) -> None:
    ga, gd = gradients()
    ev_a, ev_d, ev_p = events_of(ga, gd, 0.8, 0.6, shift)
    out = np.zeros(7)
    score = np.zeros((17, 17), np.float32)
    patch_kernels.match(table_of(ga, gd, 0.8, 0.6), PAD, A0, DM, ev_a, ev_d, ev_p, len(ev_a), 10_000, 8, 8, score, out)
    assert out[0] == pytest.approx(shift[0], abs=0.6)
    assert out[1] == pytest.approx(shift[1], abs=0.6)
    assert out[4] > 0.3
    assert out[6] == len(ev_a)


def test_match_sums_the_table_over_shifted_events() -> None:
    ga, gd = gradients(1)
    table = table_of(ga, gd, 1.0, 0.0)
    ev_a, ev_d, ev_p = events_of(ga, gd, 1.0, 0.0, (2.0, 1.0))
    score = np.zeros((9, 9), np.float32)
    patch_kernels.match(table, PAD, A0, DM, ev_a, ev_d, ev_p, len(ev_a), 10_000, 4, 4, score, np.zeros(7))
    for i, j in ((0, 0), (2, 1), (-3, 4)):
        rows = np.floor(ev_a - A0 + 0.5).astype(int) + PAD - i
        columns = np.floor(ev_d + DM + 0.5).astype(int) + PAD - j
        assert score[i + 4, j + 4] == pytest.approx(table[ev_p, rows, columns].sum(), rel=1e-4)


@pytest.mark.parametrize("angle", [0.0, 1.2, 2.6, -2.0])
def test_direction_of_motion_is_found_without_knowing_it(angle: float) -> None:
    ga, gd = gradients()
    va, vd = np.cos(angle), np.sin(angle)
    ev_a, ev_d, ev_p = events_of(ga, gd, va, vd, (3.0, -2.0))
    lean = [np.pad(g, PAD).astype(np.float32) for g in (ga, gd)]
    out = np.zeros(7)
    sums = [np.zeros((17, 17), np.float32) for _ in range(2)]
    patch_kernels.find_direction(
        lean[0], lean[1], PAD, A0, DM, ev_a, ev_d, ev_p, len(ev_a), 10_000, 8, sums[0], sums[1], out
    )
    assert np.cos(np.arctan2(out[1], out[0]) - angle) > 0.85


def test_events_are_moved_on_with_the_patch() -> None:
    last = np.full((2, 100, 160), -(10**12), np.int64)
    # A point that moved from (60, 50) at -2 ms to (64, 48) now, turning with nothing.
    last[1, 50, 60] = 18_000
    buffers = [np.zeros(patch_kernels.MAX_EVENTS) for _ in range(3)]
    polarity = np.zeros(patch_kernels.MAX_EVENTS, np.int64)
    n = patch_kernels.collect(
        last, 20_000, 5.0, 0.0, np.array([50.0, 50.0]), np.array([1.0, 0.0]), np.array([0.0, 1.0]),
        np.array([2.0, -1.0]), 0.0, np.array([0.0, 30.0, 10.0]), buffers[0], buffers[1], polarity, buffers[2],
    )  # fmt: skip
    assert n == 1
    assert (buffers[0][0], buffers[1][0], buffers[2][0], polarity[0]) == (14.0, -2.0, 2.0, 1)


def test_newest_events_are_kept() -> None:
    rng = np.random.default_rng(0)
    age = rng.uniform(0.0, 8.0, 500)
    a, d, p = np.arange(500.0), np.zeros(500), np.zeros(500, np.int64)
    kept_age = age.copy()
    n = patch_kernels.newest(a, d, p, kept_age, 500, 8.0, 100, 0.5)
    assert 100 <= n <= 125
    assert kept_age[:n].max() <= np.sort(age)[n]
    np.testing.assert_array_equal(age[a[:n].astype(int)], kept_age[:n])
    assert patch_kernels.newest(a, d, p, kept_age, 50, 8.0, 100, 0.5) == 50


@pytest.mark.parametrize("place", [-8, 0, 11])
def test_place_where_events_end_is_found(place: int) -> None:
    rng = np.random.default_rng(5)
    ev = np.concatenate([rng.uniform(-30, place, 160), rng.uniform(place, 30, 5)])
    out = np.zeros(7)
    patch_kernels.find_step(ev, len(ev), 30, np.zeros(61), out)
    assert out[1] > 12.0
    assert out[0] == pytest.approx(place, abs=2.5)


def test_events_without_an_end_give_no_step() -> None:
    ev = np.random.default_rng(5).uniform(-30, 30, 200)
    out = np.zeros(7)
    patch_kernels.find_step(ev, len(ev), 30, np.zeros(61), out)
    assert out[1] == 0.0
