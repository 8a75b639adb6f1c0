"""The filter's kernels against plain linear algebra."""

from __future__ import annotations

import numpy as np
import pytest

from motiondlo.tracking.chain import filter_kernels
from motiondlo.tracking.chain.spline import weights

K = 8


def random_state(extras: int = 3) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(1)
    n = 4 * K + extras
    root = rng.normal(size=(n, n))
    x = np.concatenate([np.arange(K) * 30.0, 100 + 5 * rng.normal(size=K), rng.normal(size=2 * K), np.zeros(extras)])
    return x, root @ root.T / n


def kalman(x: np.ndarray, P: np.ndarray, h: np.ndarray, innovation: float, R: float) -> tuple[np.ndarray, np.ndarray]:
    gain = P @ h / (h @ P @ h + R)
    return x + gain * innovation, P - np.outer(gain, h @ P)


def test_prediction_is_f_p_f_plus_q() -> None:
    x, P = random_state()
    kernel = np.exp(-np.abs(np.subtract.outer(np.arange(K), np.arange(K))) / 3.0)
    dt, decay, q = 1.5, 0.9, 0.4
    n = len(x)
    F = np.eye(n)
    F[: 2 * K, 2 * K : 4 * K] = dt * np.eye(2 * K)
    F[2 * K : 4 * K, 2 * K : 4 * K] *= decay
    Q = np.zeros((n, n))
    for a in (0, K):
        p, v = slice(a, a + K), slice(2 * K + a, 3 * K + a)
        Q[p, p], Q[v, v] = q * dt**3 / 3 * kernel, q * dt * kernel
        Q[p, v] = Q[v, p] = q * dt**2 / 2 * kernel
    want_x, want_P = F @ x, F @ P @ F.T + Q
    filter_kernels.predict(x, P, K, dt, decay, kernel, q)
    np.testing.assert_allclose(x, want_x, atol=1e-9)
    np.testing.assert_allclose(P, want_P, atol=1e-9)


def test_update_is_the_kalman_update_and_keeps_symmetry() -> None:
    x, P = random_state()
    index, entries = np.array([2, 5, 19]), np.array([0.5, -1.0, 2.0])
    h = np.zeros(len(x))
    h[index] = entries
    want_x, want_P = kalman(x, P, h, 0.7, 0.3)
    assert filter_kernels.row_variance(P, index, entries, 3) == pytest.approx(h @ P @ h)
    filter_kernels.update(x, P, index, entries, 3, 0.7, 0.3, np.zeros(len(x)))
    np.testing.assert_allclose(x, want_x, atol=1e-10)
    np.testing.assert_allclose(P, want_P, atol=1e-10)
    np.testing.assert_allclose(P, P.T, atol=1e-12)


def test_geometry_of_places_matches_differences() -> None:
    x, _ = random_state()
    u = np.linspace(0.1, K - 3.1, 9)
    out, near = np.zeros((9, 10)), np.zeros((9, 10))
    filter_kernels.place(x, K, *weights(u, K), out)
    filter_kernels.place(x, K, *weights(u + 1e-5, K), near)
    step = (near[:, :2] - out[:, :2]) / 1e-5
    np.testing.assert_allclose(out[:, 9], np.hypot(*step.T), rtol=1e-4)
    np.testing.assert_allclose(out[:, 2:4] * out[:, 9:], step, atol=1e-3)
    normal = np.stack([-out[:, 3], out[:, 2]], axis=1)
    np.testing.assert_allclose(out[:, 6], (out[:, 4:6] * normal).sum(axis=1), atol=1e-12)
    turn = np.arctan2(near[:, 3], near[:, 2]) - np.arctan2(out[:, 3], out[:, 2])
    np.testing.assert_allclose(out[:, 8], turn / (1e-5 * out[:, 9]), rtol=1e-3, atol=1e-6)


def test_normal_offset_with_age_is_one_row_of_position_and_velocity() -> None:
    x, P = random_state()
    place = weights(np.array([2.3]), K)
    g = np.zeros((1, 10))
    filter_kernels.place(x, K, *place, g)
    j, w = place[0][0], place[1][0]
    nx, ny = -g[0, 3], g[0, 2]
    h = np.zeros(len(x))
    h[j : j + 4], h[K + j : K + j + 4] = w * nx, w * ny
    h[2 * K + j : 2 * K + j + 4], h[3 * K + j : 3 * K + j + 4] = -0.8 * w * nx, -0.8 * w * ny
    innovation, R = 1.2, 0.5
    e = innovation**2 / (h @ P @ h + R)
    want_x, _ = kalman(x, P, h, innovation, R * (1 + 0.25 * e))
    use, nis = np.ones(1, np.bool_), np.zeros(1)
    used = filter_kernels.measure_normals(
        x, P, K, place[0], place[1], g, np.array([innovation]), np.array([R]), np.array([0.8]), use, 5.0, nis,
        np.zeros(len(x)),
    )  # fmt: skip
    assert used == 1
    assert nis[0] == pytest.approx(e)
    np.testing.assert_allclose(x, want_x, atol=1e-9)


def test_offsets_beyond_the_gate_are_refused() -> None:
    x, P = random_state()
    place = weights(np.array([1.5, 3.0]), K)
    g = np.zeros((2, 10))
    filter_kernels.place(x, K, *place, g)
    use, nis = np.ones(2, np.bool_), np.zeros(2)
    before = x.copy()
    used = filter_kernels.measure_normals(
        x, P, K, place[0], place[1], g, np.array([90.0, -90.0]), np.ones(2), np.zeros(2), use, 5.0, nis,
        np.zeros(len(x)),
    )  # fmt: skip
    assert used == 0
    assert not use.any()
    np.testing.assert_array_equal(x, before)


def test_lengths_come_back_and_the_common_scale_takes_what_they_share() -> None:
    x, P = random_state()
    x[:K], x[K : 2 * K] = np.arange(K) * 33.0, 0.0
    j0, _, w1, _ = weights(np.arange(0.0, K - 2.9, 0.5), K)
    P = np.diag(np.concatenate([np.full(4 * K, 4.0), [1e-9, 1e-9, 1e-9]]))
    stiff, P_stiff = x.copy(), P.copy()
    filter_kernels.keep_length(stiff, P_stiff, K, j0, w1, 30.0, 1e-4, np.zeros(len(x)))
    assert np.diff(stiff[1 : K - 1]).mean() == pytest.approx(30.0, abs=0.3)
    P[-1, -1] = 1.0
    filter_kernels.keep_length(x, P, K, j0, w1, 30.0, 1e-4, np.zeros(len(x)))
    assert x[-1] == pytest.approx(0.1, abs=0.02)
    assert np.diff(x[1 : K - 1]).mean() == pytest.approx(33.0, abs=0.7)


def test_bends_are_second_differences_along_the_normal_and_the_prior_restores_them() -> None:
    x, P = random_state()
    x[:K], x[K : 2 * K] = np.arange(K) * 30.0, 0.0
    x[K + 4] = 6.0
    own = np.zeros(K)
    filter_kernels.bends(x, K, own)
    np.testing.assert_allclose(own[2:7], [0.0, 6.0, -12.0, 6.0, 0.0], atol=0.6)
    filter_kernels.keep_shape(x, P, K, np.zeros(K), 1e-3, np.zeros(len(x)))
    straightened = np.zeros(K)
    filter_kernels.bends(x, K, straightened)
    assert np.abs(straightened).max() < 0.2


def test_velocity_variance_is_limited_and_the_covariance_stays_one() -> None:
    _, P = random_state()
    P *= 50.0
    filter_kernels.limit_velocity_variance(P, K, 9.0)
    assert np.diag(P)[2 * K : 4 * K].max() <= 9.0 + 1e-9
    assert np.linalg.eigvalsh(P).min() > -1e-9
