"""Estimate a homography from point pairs: normalised DLT, RANSAC, maximum likelihood on what belongs together.

Legend: ``p`` (N, 2) source points, ``q`` (N, 2) target points, ``H`` target_from_source, ``J`` Jacobians. The error is
the symmetric transfer error of the paper (its "Homography estimation"): target px one way, source px the other way.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from motiondlo.errors import CalibrationError
from motiondlo.geometry.homography import checked_homography, warp_points

FloatArray = npt.NDArray[np.float64]
BoolArray = npt.NDArray[np.bool_]

_SAMPLES = 600
_BEYOND_SIGMA = 4.5  # generous: the estimate of sigma from two dozen points is itself off by a fifth
_LEAST_SHARE = 0.4
_HEAVY_TAIL_NU = 4.0
_HEAVY_TAIL_EVIDENCE = 3.0  # gain in log-likelihood before the Gaussian is given up
_ITERATIONS = 30


@dataclass(frozen=True)
class HomographyFit:
    """The estimate and how well the points agree with it."""

    target_from_source: FloatArray
    """(3, 3), last element 1."""
    inliers: BoolArray
    """(N,) True where a pair was used."""
    forward_px: FloatArray
    """(N, 2) residuals in the target image: mapped source point minus target point."""
    symmetric_px: FloatArray
    """(N,) symmetric transfer error: root mean square of the distances in both images."""
    sigma_px: float
    """Standard deviation of the inliers' target points, per axis."""
    heavy_tailed: bool
    """The residuals called for Student's t instead of the Gaussian."""


def normalising(points: FloatArray) -> FloatArray:
    """Similarity (3, 3) that brings (N, 2) points to their centroid at a mean distance of sqrt(2)."""
    centre = points.mean(axis=0)
    spread = float(np.hypot(*(points - centre).T).mean())
    scale = np.sqrt(2.0) / max(spread, 1e-12)
    return np.array([[scale, 0.0, -scale * centre[0]], [0.0, scale, -scale * centre[1]], [0.0, 0.0, 1.0]])


def dlt(p: FloatArray, q: FloatArray) -> FloatArray:
    """Direct linear transform of N >= 4 pairs, in normalised coordinates.

    p, q: (..., N, 2); leading axes are independent problems that share one normalisation. Returns (..., 3, 3).
    """
    tp, tq = normalising(p.reshape(-1, 2)), normalising(q.reshape(-1, 2))
    a, b = _affine(p, tp), _affine(q, tq)
    x, y, u, v = a[..., 0], a[..., 1], b[..., 0], b[..., 1]
    one, zero = np.ones_like(x), np.zeros_like(x)
    rows = np.concatenate(
        [
            np.stack([x, y, one, zero, zero, zero, -u * x, -u * y, -u], axis=-1),
            np.stack([zero, zero, zero, x, y, one, -v * x, -v * y, -v], axis=-1),
        ],
        axis=-2,
    )
    # The null space from the normal matrix's eigenvectors would lose half the digits; the SVD does not.
    h = np.linalg.svd(rows, full_matrices=True)[2][..., -1, :].reshape(*rows.shape[:-2], 3, 3)
    return np.asarray(np.linalg.inv(tq) @ h @ tp, dtype=np.float64)


def symmetric_transfer_px(p: FloatArray, q: FloatArray, target_from_source: FloatArray) -> FloatArray:
    """(N,) root mean square of the distances in target and source image; inf where a point maps to infinity."""
    with np.errstate(all="ignore"):
        forward = warp_points(p, target_from_source) - q
        try:
            backward = warp_points(q, np.asarray(np.linalg.inv(target_from_source), dtype=np.float64)) - p
        except np.linalg.LinAlgError:
            return np.full(len(p), np.inf)
        error = np.sqrt(((forward**2).sum(axis=1) + (backward**2).sum(axis=1)) / 2.0)
    return np.where(np.isfinite(error), error, np.inf)


def ransac(p: FloatArray, q: FloatArray, max_error_px: float, seed: int = 0) -> tuple[FloatArray, BoolArray]:
    """Best of many homographies through four pairs, by the truncated squared symmetric transfer error.

    Deterministic for a seed. Returns (3, 3) and the (N,) pairs within ``max_error_px``. Raises CalibrationError when
    fewer than four pairs, or than two in five, agree.
    """
    n = len(p)
    rng = np.random.default_rng(seed)
    samples = np.argsort(rng.random((_SAMPLES, n)), axis=1)[:, :4]
    candidates = [dlt(p, q), *dlt(p[samples], q[samples])]
    best, best_cost, best_error = candidates[0], np.inf, np.full(n, np.inf)
    for h in candidates:
        error = symmetric_transfer_px(p, q, h)
        cost = float((np.minimum(error / max_error_px, 1.0) ** 2).sum())
        if cost < best_cost:
            best, best_cost, best_error = h, cost, error
    inliers = best_error < max_error_px
    # Any four pairs agree with some homography: it takes more than those to be believed.
    if inliers.sum() < max(4.0, _LEAST_SHARE * n):
        raise CalibrationError(
            f"no homography explains more than {int(inliers.sum())} of {n} point pairs within {max_error_px:g} px.",
            "Check that both columns list the same points in the same order.",
        )
    return best, inliers


def fit_homography(p: FloatArray, q: FloatArray, max_error_px: float = 5.0, seed: int = 0) -> HomographyFit:
    """Maximum-likelihood homography of N >= 4 pairs with outliers.

    RANSAC finds pairs that agree; then pairs are refused by a robust estimate of the noise itself, and the symmetric
    transfer error of the others is minimised, with the weights of Student's t where their tails are heavy. p, q: (N, 2)
    source and target px. Raises CalibrationError when too few agree or the result is singular.
    """
    h, inliers = ransac(p, q, max_error_px, seed)
    weights = inliers.astype(np.float64)
    for _ in range(_ITERATIONS):
        h = minimise_transfer(p, q, weights, h)
        error = symmetric_transfer_px(p, q, h)
        limit = min(_BEYOND_SIGMA * _robust_sigma(error[inliers], int(inliers.sum())), max_error_px * 2.0)
        now = error <= max(limit, 1e-6)
        if now.sum() < 4 or (now == inliers).all():
            break
        inliers, weights = now, now.astype(np.float64)
    sigma2 = _gaussian_sigma2(error, inliers)
    heavy, h_t = _student(p, q, h, inliers, sigma2)
    if heavy:
        h = h_t
    h = checked_homography(h, "fitted homography")
    forward = warp_points(p, h) - q
    used = int(inliers.sum())
    sigma = float(np.sqrt((forward[inliers] ** 2).sum() / max(2 * used - 8, 1))) if used > 4 else 0.0
    return HomographyFit(h, inliers, forward, symmetric_transfer_px(p, q, h), sigma, heavy)


def minimise_transfer(p: FloatArray, q: FloatArray, weights: FloatArray, start: FloatArray) -> FloatArray:
    """Levenberg-Marquardt on the weighted squared symmetric transfer error, from ``start``. Returns (3, 3)."""
    tp, tq = normalising(p), normalising(q)
    a, b = _affine(p, tp), _affine(q, tq)
    # Residuals are divided by the normalisation's scale so that both images count in pixels.
    scale_q, scale_p = 1.0 / tq[0, 0], 1.0 / tp[0, 0]
    h = tq @ start @ np.linalg.inv(tp)
    h /= h[2, 2]
    root = np.sqrt(weights)
    lam, (r, jac) = 1e-4, _residuals(a, b, h, root, scale_q, scale_p)
    cost = float(r @ r)
    for _ in range(_ITERATIONS):
        normal, gradient = jac.T @ jac, jac.T @ r
        step = np.linalg.solve(normal + lam * np.diag(np.diag(normal)) + 1e-15 * np.eye(8), -gradient)
        trial = (h.ravel() + np.append(step, 0.0)).reshape(3, 3)
        r_new, jac_new = _residuals(a, b, trial, root, scale_q, scale_p)
        cost_new = float(r_new @ r_new)
        if not np.isfinite(cost_new) or cost_new > cost:
            lam *= 10.0
            if lam > 1e8:
                break
            continue
        done = cost - cost_new <= 1e-12 * max(cost, 1e-30)
        h, r, jac, cost, lam = trial, r_new, jac_new, cost_new, max(lam * 0.1, 1e-12)
        if done:
            break
    return np.asarray(np.linalg.inv(tq) @ h @ tp, dtype=np.float64)


def _residuals(
    a: FloatArray, b: FloatArray, h: FloatArray, root: FloatArray, scale_q: float, scale_p: float
) -> tuple[FloatArray, FloatArray]:
    """Residuals of both directions (4N,) and their Jacobian (4N, 8) by the first eight elements of ``h``."""
    with np.errstate(all="ignore"):
        forward, jf = _mapped(a, h)
        back = warp_points(b, np.asarray(np.linalg.inv(h), dtype=np.float64))
        _, jb = _mapped(back, h)
        # d(H^-1 q) = -(dH p / dp)^-1 dH p / dh, at p = H^-1 q.
        w = back @ h[2, :2] + h[2, 2]
        u = (back @ h[:2, :2].T + h[:2, 2]) / w[:, None]
        dp = (h[None, :2, :2] - u[:, :, None] * h[None, None, 2, :2]) / w[:, None, None]
        jb = -np.linalg.solve(dp, jb)
    r = np.concatenate(
        [((forward - b) * root[:, None] * scale_q).ravel(), ((back - a) * root[:, None] * scale_p).ravel()]
    )
    jac = np.concatenate(
        [(jf * root[:, None, None] * scale_q).reshape(-1, 8), (jb * root[:, None, None] * scale_p).reshape(-1, 8)]
    )
    used = np.repeat(root > 0, 2)
    used = np.concatenate([used, used])
    return np.where(used, r, 0.0), np.where(used[:, None], jac, 0.0)


def _mapped(points: FloatArray, h: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Mapped points (N, 2) and their Jacobian (N, 2, 8) by the first eight elements of ``h``."""
    x, y = points.T
    w = h[2, 0] * x + h[2, 1] * y + h[2, 2]
    u, v = (h[0, 0] * x + h[0, 1] * y + h[0, 2]) / w, (h[1, 0] * x + h[1, 1] * y + h[1, 2]) / w
    one, zero = np.ones_like(x), np.zeros_like(x)
    j = np.stack(
        [
            np.stack([x, y, one, zero, zero, zero, -u * x, -u * y], axis=1),
            np.stack([zero, zero, zero, x, y, one, -v * x, -v * y], axis=1),
        ],
        axis=1,
    )
    return np.stack([u, v], axis=1), np.asarray(j / w[:, None, None], dtype=np.float64)


def _student(p: FloatArray, q: FloatArray, h: FloatArray, inliers: BoolArray, sigma2: float) -> tuple[bool, FloatArray]:
    """Student's t by expectation-maximisation on the inliers; True when it explains them clearly better."""
    if inliers.sum() < 12 or sigma2 <= 0.0:
        return False, h
    nu = _HEAVY_TAIL_NU
    error2 = symmetric_transfer_px(p, q, h)[inliers] ** 2
    gauss = float((-np.log(2 * np.pi * sigma2) - error2 / (2 * sigma2)).sum())
    spread, h_t = sigma2 / 2.0, h
    for _ in range(_ITERATIONS):
        w = (nu + 2.0) / (nu + error2 / spread)
        weights = np.zeros(len(p))
        weights[inliers] = w
        h_t = minimise_transfer(p, q, weights, h_t)
        error2 = symmetric_transfer_px(p, q, h_t)[inliers] ** 2
        was, spread = spread, float((w * error2).sum() / (2 * len(w)))
        if abs(was - spread) < 1e-6 * spread:
            break
    t = float((-np.log(2 * np.pi * spread) - (nu + 2.0) / 2.0 * np.log1p(error2 / (nu * spread))).sum())
    return t - gauss > _HEAVY_TAIL_EVIDENCE, h_t


def _robust_sigma(error: FloatArray, n: int) -> float:
    """Standard deviation per axis from the median distance, with the correction for 8 parameters of few points."""
    rayleigh_median = np.sqrt(2.0 * np.log(2.0))
    return float(np.median(error) / rayleigh_median * np.sqrt(2.0 * n / max(2 * n - 8, 1)))


def _gaussian_sigma2(error: FloatArray, inliers: BoolArray) -> float:
    return float((error[inliers] ** 2).sum() / (2 * max(int(inliers.sum()), 1)))


def _affine(points: FloatArray, t: FloatArray) -> FloatArray:
    return np.asarray(points * t[0, 0] + t[:2, 2], dtype=np.float64)


def expected_error_px(p: FloatArray, q: FloatArray, fit: HomographyFit, target_px: FloatArray) -> FloatArray:
    """Expected distance (root mean square) between the fitted map and the true one at places of the target image.

    p, q: (N, 2) the pairs that were used; target_px: (K, 2). Returns (K,), from the covariance of the least squares;
    zeros when there are no more than four pairs, which leave no residuals to judge by.
    """
    tp, tq = normalising(p), normalising(q)
    h = tq @ fit.target_from_source @ np.linalg.inv(tp)
    h /= h[2, 2]
    jac = _mapped(_affine(p, tp), h)[1].reshape(-1, 8)
    cov = np.linalg.pinv(jac.T @ jac) * (fit.sigma_px * tq[0, 0]) ** 2
    places = warp_points(target_px, np.asarray(np.linalg.inv(fit.target_from_source), dtype=np.float64))
    at = _mapped(_affine(places, tp), h)[1]
    variance = np.einsum("kij,jl,kil->k", at, cov, at)
    return np.asarray(np.sqrt(np.maximum(variance, 0.0)) / tq[0, 0], dtype=np.float64)
