"""Prediction and update equal their plain matrix forms."""

from __future__ import annotations

import numpy as np
import pytest

from motiondlo.tracking.inextensible.filter_kernels import CONSTANTS, keep_bend, predict, solve

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
    start, cov = some_state()
    rng = np.random.default_rng(7)
    h, z, w = rng.normal(size=(12, SIZE)), rng.normal(size=12), np.full(12, 4.0)
    gain = cov @ h.T @ np.linalg.inv(h @ cov @ h.T + np.diag(1.0 / w))
    step = 0.1 * start
    want_step, want_cov = step + gain @ (z - h @ step), cov - gain @ h @ cov
    padded = np.vstack([h, np.full((8, SIZE), np.nan)])
    padded_z, padded_w = np.append(z, np.full(8, np.nan)), np.append(w, np.ones(8))
    assert solve(cov, step, padded, padded_z, padded_w, 12, 4.0, 3, np.zeros(20, np.uint8))
    np.testing.assert_allclose(step, want_step, atol=1e-8)
    np.testing.assert_allclose(cov, want_cov, atol=1e-8)


def test_bend_one_by_one_equals_all_rows_at_once() -> None:
    n, dt = 8, 0.5
    size = 2 * n + CONSTANTS
    rng = np.random.default_rng(8)
    a = rng.normal(size=(size, size))
    x, cov, memory = rng.normal(size=size), a @ a.T + np.eye(size), rng.normal(size=n)
    rows, z, w = [], [], []
    for part, sigma in enumerate((0.3, 0.7)):
        for k in range(3, n - 1):
            row = np.zeros(size)
            row[part * n + k - 1 : part * n + k + 2] = 1.0, -2.0, 1.0
            rows.append(row)
            z.append((memory[k] if part == 0 else 0.0) - row @ x)
            w.append(dt / sigma**2)
    want_cov, want_step = cov.copy(), np.zeros(size)
    assert solve(want_cov, want_step, np.array(rows), np.array(z), np.array(w), len(z), 4.0, 1,
                 np.zeros(len(z), np.uint8))  # fmt: skip
    step = np.zeros(size)
    keep_bend(n, dt, x, memory, 0.3, 0.7, cov, step, np.zeros(size))
    np.testing.assert_allclose(step, want_step, atol=1e-8)
    np.testing.assert_allclose(cov, want_cov, atol=1e-8)


def test_one_wild_station_does_not_pull() -> None:
    cov = np.eye(SIZE)
    h = np.zeros((6, SIZE))
    h[:, 0] = 1.0
    z = np.array([0.1, -0.1, 0.0, 0.05, -0.05, 40.0])
    step = np.zeros(SIZE)
    assert solve(cov, step, h, z, np.full(6, 4.0), 6, 4.0, 5, np.ones(6, np.uint8))
    assert step[0] == pytest.approx(0.0, abs=0.15)


def test_an_update_whose_numbers_fail_says_so() -> None:
    _, cov = some_state()
    h = np.eye(SIZE)[:2].copy()
    plain = np.zeros(2, np.uint8)
    assert not solve(cov.copy(), np.zeros(SIZE), h, np.array([0.0, np.nan]), np.ones(2), 2, 4.0, 1, plain)
    assert not solve(-cov, np.zeros(SIZE), h, np.zeros(2), np.ones(2), 2, 4.0, 2, plain)
