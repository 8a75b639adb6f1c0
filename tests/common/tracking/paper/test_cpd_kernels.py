"""The registration's kernels against plain numpy."""

from __future__ import annotations

import numpy as np
import pytest

from motiondlo.geometry.curve import arc_length
from motiondlo.tracking.paper.cpd_kernels import e_step, nearest_squared, register_nodes, solve_in_place
from motiondlo.tracking.paper.geodesic import mct_kernel


def geodesic_squared(Y: np.ndarray, X: np.ndarray, s: np.ndarray) -> np.ndarray:
    """(M, N) squared two-anchor distances."""
    straight = np.linalg.norm(Y[:, None] - X[None], axis=2)
    out = np.empty_like(straight)
    m = len(Y)
    for n in range(len(X)):
        first = int(straight[:, n].argmin())
        others = [k for k in (first - 1, first + 1) if 0 <= k < m]
        second = min(others, key=lambda k, n=n: straight[k, n])
        low, high = sorted((first, second))
        for k in range(m):
            anchor = low if k <= low else high
            out[k, n] = (abs(s[k] - s[anchor]) + straight[anchor, n]) ** 2
    return out


def posteriors(
    Y: np.ndarray, X: np.ndarray, w: np.ndarray, s: np.ndarray, sigma2: float, mu: float, unit: float, k_vis: float,
    two_anchor: bool,
) -> np.ndarray:  # fmt: skip
    """(M, N) P as the paper writes it."""
    straight = np.linalg.norm(Y[:, None] - X[None], axis=2)
    d2 = geodesic_squared(Y, X, s) if two_anchor else straight**2
    nu = np.exp(-k_vis * straight.min(axis=1))
    p = w[None] * nu[:, None] * np.exp(-d2 / (2 * sigma2))
    c = 2 * np.pi * sigma2 / unit**2 * mu / (1 - mu) * len(Y) / len(X)
    return p / (p.sum(axis=0) + c)


@pytest.fixture
def scene() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """A bent chain of 12 nodes 30 px apart, 90 observations beside it, their weights."""
    rng = np.random.default_rng(3)
    angle = np.linspace(0.0, 1.6, 12)
    Y = np.stack([200 * np.sin(angle), 200 * (1 - np.cos(angle))], axis=1)
    u = rng.uniform(0, 1.6, 90)
    X = np.stack([206 * np.sin(u), 4 + 206 * (1 - np.cos(u))], axis=1) + rng.normal(0, 2, (90, 2))
    return Y, X, rng.uniform(0.3, 1.0, 90)


@pytest.mark.parametrize("two_anchor", [True, False])
def test_e_step_is_the_papers_posterior(scene: tuple[np.ndarray, ...], two_anchor: bool) -> None:
    Y, X, w = scene
    s = arc_length(Y)
    near2, unused = np.empty(len(Y)), np.empty(len(X))
    nearest_squared(Y, X, near2, unused)
    np.testing.assert_allclose(near2, (np.linalg.norm(Y[:, None] - X[None], axis=2) ** 2).min(axis=1))
    P1, PX = np.empty(len(Y)), np.empty((len(Y), 2))
    PXX = e_step(Y, X, w, s, 90.0, 0.1, 25.0, 0.05, two_anchor, near2, np.empty(len(Y)), P1, PX)
    P = posteriors(Y, X, w, s, 90.0, 0.1, 25.0, 0.05, two_anchor)
    np.testing.assert_allclose(P1, P.sum(axis=1), atol=1e-9)
    np.testing.assert_allclose(PX, P @ X, atol=1e-6)
    assert pytest.approx((P.sum(axis=0) * (X**2).sum(axis=1)).sum()) == PXX


def test_one_iteration_solves_the_regularised_m_step(scene: tuple[np.ndarray, ...]) -> None:
    Y, X, w = scene
    s = arc_length(Y)
    G = mct_kernel(np.abs(s[:, None] - s[None]), 20.0)
    prior = np.linspace(0.0, 1.0, len(Y))
    goal = Y + 3.0
    out, P1, sigma2, done = register_nodes(
        Y, X, w, G, s, prior, goal, 60.0, 1e-6, 1e-4, 0.1, 25.0, 0.5, 0.05, True, 1, 0.0
    )
    P = posteriors(Y, X, w, s, 60.0, 0.1, 25.0, 0.05, True)
    L = np.diff(np.eye(len(Y)), axis=0)
    A = (np.diag(P.sum(axis=1)) + np.diag(prior)) @ G + 1e-4 * 60.0 * np.eye(len(Y)) + 0.5 * L.T @ L
    B = P @ X - P.sum(axis=1)[:, None] * Y + prior[:, None] * (goal - Y)
    expected = Y + G @ np.linalg.solve(A, B)
    np.testing.assert_allclose(out, expected, atol=1e-8)
    np.testing.assert_allclose(P1, P.sum(axis=1), atol=1e-9)
    residual = np.linalg.norm(expected[:, None] - X[None], axis=2) ** 2
    assert sigma2 == pytest.approx((P * residual).sum() / (2 * P.sum()), rel=1e-6)
    assert done == 1


def test_registration_moves_the_chain_onto_the_observations(scene: tuple[np.ndarray, ...]) -> None:
    Y, X, _ = scene
    s = arc_length(Y)
    G = mct_kernel(np.abs(s[:, None] - s[None]), 20.0)
    none = np.zeros(len(Y))
    out, *_ = register_nodes(
        Y, X, np.ones(len(X)), G, s, none, Y, 225.0, 4.0, 1e-4, 0.1, 25.0, 0.5, 0.0, True, 25, 1e-3
    )
    radius = np.hypot(out[2:-2, 0], out[2:-2, 1] - 210.0)
    assert np.abs(radius - 206.0).mean() < 1.5


def test_singular_system_and_duplicate_nodes_leave_the_chain_finite() -> None:
    assert not solve_in_place(np.zeros((3, 3)), np.ones((3, 2)))
    assert not solve_in_place(np.full((3, 3), np.nan), np.ones((3, 2)))
    Y = np.zeros((6, 2))
    s = arc_length(Y)
    G = mct_kernel(np.abs(s[:, None] - s[None]), 20.0)
    none = np.zeros(6)
    out, *_ = register_nodes(
        Y, np.ones((4, 2)), np.ones(4), G, s, none, Y, 4.0, 4.0, 0.0, 0.1, 1.0, 0.0, 0.05, True, 8, 0.0
    )
    assert np.isfinite(out).all()


def test_elimination_agrees_with_numpy() -> None:
    rng = np.random.default_rng(0)
    A, B = rng.normal(size=(20, 20)), rng.normal(size=(20, 2))
    A[0, 0] = 0.0  # needs a pivot
    W = B.copy()
    assert solve_in_place(A.copy(), W)
    np.testing.assert_allclose(W, np.linalg.solve(A, B), atol=1e-9)
