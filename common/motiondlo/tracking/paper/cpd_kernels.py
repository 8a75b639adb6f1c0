"""Kernels of the coherent point drift: E-step along the chain, M-step, noise variance.

Legend: ``Y`` (M, 2) nodes, ``X`` (N, 2) observations, ``G`` (M, M) kernel, ``s`` (M,) arc length of the nodes,
``P`` (M, N) posteriors, ``W`` (M, 2) deformation weights, D = 2.
"""

from __future__ import annotations

import numba
import numpy as np
import numpy.typing as npt

FloatArray = npt.NDArray[np.float64]


@numba.njit(cache=True, nogil=True)
def nearest_squared(Y: FloatArray, X: FloatArray, of_nodes: FloatArray, of_observations: FloatArray) -> None:
    """Squared distance of every node to its nearest observation (M,) and the reverse (N,), both written."""
    of_nodes[:] = np.inf
    for n in range(X.shape[0]):
        best = np.inf
        for m in range(Y.shape[0]):
            d2 = (X[n, 0] - Y[m, 0]) ** 2 + (X[n, 1] - Y[m, 1]) ** 2
            best = min(best, d2)
            of_nodes[m] = min(of_nodes[m], d2)
        of_observations[n] = best


@numba.njit(cache=True, nogil=True)
def e_step(
    Y: FloatArray,
    X: FloatArray,
    w: FloatArray,
    s: FloatArray,
    sigma2: float,
    mu: float,
    unit_px: float,
    k_vis: float,
    two_anchor: bool,
    near2: FloatArray,
    p: FloatArray,
    P1: FloatArray,
    PX: FloatArray,
) -> float:
    """Posteriors (paper, "Two-pass registration"), reduced to what the M-step needs.

    w: (N,) observation weights; they scale the data terms and not the outlier constant c. near2: (M,) squared distance
    of each node to its nearest observation, for its visibility exp(-k_vis d). unit_px: the length in which c measures
    sigma; c weighs a Gaussian against a uniform density of one per unit of area, and with pixels for units nearly every
    observation would be an outlier. p: (M,) scratch. Writes P1 = P 1 (M,) and
    PX = P X (M, 2); returns the sum of P |x|^2, which the noise variance of the moved nodes needs.

    Two anchors: of an observation's nearest node and the better of that node's neighbours, the one on a node's side is
    where the way from the observation to that node enters the chain: d = |s_m - s_anchor| + |x - y_anchor|.
    """
    M = Y.shape[0]
    N = X.shape[0]
    c = 2.0 * np.pi * sigma2 / unit_px**2 * mu / (1.0 - mu) * M / N
    P1[:] = 0.0
    PX[:, :] = 0.0
    PXX = 0.0
    for n in range(N):
        x0 = X[n, 0]
        x1 = X[n, 1]
        first = 0
        best = np.inf
        for m in range(M):
            d2 = (x0 - Y[m, 0]) ** 2 + (x1 - Y[m, 1]) ** 2
            p[m] = d2
            if d2 < best:
                best = d2
                first = m
        low = first
        high = first
        if two_anchor:
            if first == 0:
                high = 1
            elif first == M - 1:
                low = M - 2
            elif p[first - 1] <= p[first + 1]:
                low = first - 1
            else:
                high = first + 1
        d_low = np.sqrt(p[low])
        d_high = np.sqrt(p[high])
        total = c
        for m in range(M):
            d2 = p[m]
            if two_anchor:
                if m <= low:
                    d2 = (s[low] - s[m] + d_low) ** 2
                else:
                    d2 = (s[m] - s[high] + d_high) ** 2
            e = d2 / (2.0 * sigma2)
            p[m] = 0.0
            if e < 40.0:
                p[m] = w[n] * np.exp(-e - k_vis * np.sqrt(near2[m]))
                total += p[m]
        if total <= 0.0:
            continue
        for m in range(M):
            if p[m] > 0.0:
                q = p[m] / total
                P1[m] += q
                PX[m, 0] += q * x0
                PX[m, 1] += q * x1
                PXX += q * (x0 * x0 + x1 * x1)
    return PXX


@numba.njit(cache=True, nogil=True)
def solve_in_place(A: FloatArray, B: FloatArray) -> bool:
    """Solve A W = B by elimination with row pivoting; W replaces B. False, with B unusable, when A is singular."""
    M = A.shape[0]
    scale = 0.0
    for i in range(M):
        for j in range(M):
            scale = max(scale, abs(A[i, j]))
    if not np.isfinite(scale) or scale == 0.0:
        return False
    for k in range(M):
        pivot = k
        for i in range(k + 1, M):
            if abs(A[i, k]) > abs(A[pivot, k]):
                pivot = i
        if abs(A[pivot, k]) < 1e-14 * scale:
            return False
        if pivot != k:
            for j in range(M):
                A[k, j], A[pivot, j] = A[pivot, j], A[k, j]
            for j in range(B.shape[1]):
                B[k, j], B[pivot, j] = B[pivot, j], B[k, j]
        for i in range(k + 1, M):
            f = A[i, k] / A[k, k]
            if f != 0.0:
                for j in range(k, M):
                    A[i, j] -= f * A[k, j]
                for j in range(B.shape[1]):
                    B[i, j] -= f * B[k, j]
    for k in range(M - 1, -1, -1):
        for j in range(B.shape[1]):
            total = B[k, j]
            for i in range(k + 1, M):
                total -= A[k, i] * B[i, j]
            B[k, j] = total / A[k, k]
    return True


@numba.njit(cache=True, nogil=True)
def register_nodes(
    Y0: FloatArray,
    X: FloatArray,
    w: FloatArray,
    G: FloatArray,
    s: FloatArray,
    prior: FloatArray,
    Y_prior: FloatArray,
    sigma2_start: float,
    sigma2_floor: float,
    lam: float,
    mu: float,
    unit_px: float,
    mu_motion: float,
    k_vis: float,
    two_anchor: bool,
    iterations: int,
    tolerance: float,
) -> tuple[FloatArray, FloatArray, float, int]:
    """Expectation maximisation from Y0 (paper, "MCT geodesic kernel", "Chain Laplacian", "Correspondence prior").

    M-step: ((diag(P1) + diag(prior)) G + lam sigma2 I + mu_motion L'L) W = P X - diag(P1) Y0 + diag(prior) (Y_prior -
    Y0), Y = Y0 + G W, with L the first difference along the chain. prior: (M,) weights, 0 for none. A singular system
    ends the iteration with the nodes as they are. Returns Y (M, 2), P1 (M,), sigma2 and the number of iterations.
    """
    M = Y0.shape[0]
    N = X.shape[0]
    Y = Y0.copy()
    sigma2 = sigma2_start
    P1 = np.zeros(M)
    PX = np.zeros((M, 2))
    p = np.empty(M)
    near2 = np.empty(M)
    unused = np.empty(N)
    A = np.empty((M, M))
    B = np.empty((M, 2))
    done = 0
    for _ in range(iterations):
        nearest_squared(Y, X, near2, unused)
        PXX = e_step(Y, X, w, s, sigma2, mu, unit_px, k_vis, two_anchor, near2, p, P1, PX)
        for i in range(M):
            for j in range(M):
                A[i, j] = (P1[i] + prior[i]) * G[i, j]
            A[i, i] += lam * sigma2 + mu_motion * (1.0 if i == 0 or i == M - 1 else 2.0)
            if i > 0:
                A[i, i - 1] -= mu_motion
                A[i - 1, i] -= mu_motion
            for d in range(2):
                B[i, d] = PX[i, d] - P1[i] * Y0[i, d] + prior[i] * (Y_prior[i, d] - Y0[i, d])
        if not solve_in_place(A, B):
            break
        done += 1
        shift = 0.0
        for i in range(M):
            d0 = Y0[i, 0] - Y[i, 0]
            d1 = Y0[i, 1] - Y[i, 1]
            for j in range(M):
                d0 += G[i, j] * B[j, 0]
                d1 += G[i, j] * B[j, 1]
            Y[i, 0] += d0
            Y[i, 1] += d1
            shift += np.sqrt(d0 * d0 + d1 * d1)
        weight = P1.sum()
        if weight > 1e-9:
            # sum of P |x - y|^2 with the posteriors of the old and the places of the new nodes
            spread = PXX
            for m in range(M):
                spread += P1[m] * (Y[m, 0] ** 2 + Y[m, 1] ** 2) - 2.0 * (PX[m, 0] * Y[m, 0] + PX[m, 1] * Y[m, 1])
            sigma2 = max(spread / (2.0 * weight), sigma2_floor)
        if shift / M < tolerance:
            break
    return Y, P1, sigma2, done
