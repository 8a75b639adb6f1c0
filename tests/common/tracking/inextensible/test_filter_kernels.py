"""Prediction and update equal their plain matrix forms."""

from __future__ import annotations

import numpy as np
import pytest

from motiondlo.tracking.inextensible.filter_kernels import CONSTANTS, predict, solve

N = 6
SIZE = 2 * N + CONSTANTS


def some_state() -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(5)
    a = rng.normal(size=(SIZE, SIZE))
    return rng.normal(size=SIZE), a @ a.T + np.eye(SIZE)


def test_predict_equals_the_transition_matrix() -> None:
    x, cov = some_state()
    b = np.random.default_rng(6).normal(size=(N, N))
    acceleration = b @ b.T
    dt, decay, scale = 1.5, 0.98, 0.3
    q = np.array([1e-4, 0.0, 0.0, 2e-3, 0.0])
    f = np.eye(SIZE)
    f[:N, N : 2 * N] = dt * np.eye(N)
    f[N : 2 * N, N : 2 * N] *= decay
    noise = np.zeros((SIZE, SIZE))
    noise[:N, :N] = acceleration * scale * dt**3 / 3
    noise[:N, N : 2 * N] = acceleration * scale * dt**2 / 2
    noise[N : 2 * N, :N] = noise[:N, N : 2 * N].T
    noise[N : 2 * N, N : 2 * N] = acceleration * scale * dt
    noise[2 * N :, 2 * N :] = np.diag(q * dt)
    want_x, want_cov = f @ x, f @ cov @ f.T + noise
    predict(x, cov, N, dt, decay, acceleration, scale, q)
    np.testing.assert_allclose(x, want_x, atol=1e-12)
    np.testing.assert_allclose(cov, want_cov, atol=1e-9)


def test_solve_without_outliers_is_the_kalman_update() -> None:
    x, cov = some_state()
    rng = np.random.default_rng(7)
    h, z, w = rng.normal(size=(12, SIZE)), rng.normal(size=12), np.full(12, 4.0)
    gain = cov @ h.T @ np.linalg.inv(h @ cov @ h.T + np.diag(1.0 / w))
    want_x, want_cov = x + gain @ z, cov - gain @ h @ cov
    residual = np.zeros(20)
    padded = np.vstack([h, np.full((8, SIZE), np.nan)])
    assert solve(x, cov, padded, np.append(z, np.full(8, np.nan)), np.append(w, np.ones(8)), 12, 4.0, 3,
          np.zeros(20, np.uint8), residual)  # fmt: skip
    np.testing.assert_allclose(x, want_x, atol=1e-8)
    np.testing.assert_allclose(cov, want_cov, atol=1e-8)


def test_one_wild_station_does_not_pull() -> None:
    cov = np.eye(SIZE)
    h = np.zeros((6, SIZE))
    h[:, 0] = 1.0
    z = np.array([0.1, -0.1, 0.0, 0.05, -0.05, 40.0])
    x = np.zeros(SIZE)
    solve(x, cov, h, z, np.full(6, 4.0), 6, 4.0, 5, np.ones(6, np.uint8), np.zeros(6))
    assert x[0] == pytest.approx(0.0, abs=0.15)


def test_an_update_that_fails_changes_nothing() -> None:
    x, cov = some_state()
    before = cov.copy()
    h = np.eye(SIZE)[:2].copy()
    z, plain, residual = np.array([0.0, np.nan]), np.zeros(2, np.uint8), np.zeros(2)
    assert not solve(x, cov, h, z, np.ones(2), 2, 4.0, 1, plain, residual)
    with pytest.raises(np.linalg.LinAlgError):
        solve(x, cov, h, z, np.ones(2), 2, 4.0, 2, plain, residual)
    np.testing.assert_array_equal(cov, before)
