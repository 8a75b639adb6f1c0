"""One registration of the chain to the observations (paper, "CPD Tracker").

Legend: ``Y`` (M, 2) nodes, ``X`` (N, 2) observations, ``V`` (M, 2) velocity.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from motiondlo.geometry.curve import arc_length, distance_to_curve, resample
from motiondlo.tracking.paper.cpd_kernels import nearest_squared, register_nodes
from motiondlo.tracking.paper.geodesic import chain_coordinates, mct_kernel, node_distances
from motiondlo.tracking.paper.params import PaperParams

FloatArray = npt.NDArray[np.float64]

# Observations with less weight than this are beyond the coarse trust region and are left out (paper: it "only removes
# observations far from the curve").
_TRUST_WEIGHT = 0.01


@dataclass(frozen=True)
class Registration:
    """The outcome of one registration."""

    nodes: FloatArray
    """(M, 2) event px, as registered: neither extended nor resampled."""
    sigma2_px2: float
    residual_px: float
    """Mean distance of the observations to the curve (the paper's d-bar)."""
    support: FloatArray
    """(M,) distance of each node to its nearest observation, px."""
    observations: FloatArray
    """(M,) how many observations each node was given (P 1)."""


def cold_sigma2(nodes: FloatArray, params: PaperParams) -> float:
    """(s / 2)^2 from the mean spacing s, within sigma2_max (paper, "Noise variance management")."""
    spacing = float(arc_length(nodes)[-1]) / (len(nodes) - 1)
    return float(np.clip((spacing / 2.0) ** 2, params.sigma2_min_px2, params.sigma2_max_px2))


def register(Y0: FloatArray, X: FloatArray, sigma2_px2: float, params: PaperParams) -> Registration | None:
    """Register the predicted nodes Y0 to X (paper, "Two-pass registration with soft observation weighting").

    The residual is taken from the observations to the curve: taken the other way, nodes at rest, hidden or outside the
    image, which no observation can be near to, would count as lost contact. Returns None when fewer than three
    observations lie in the trust region, or the outcome is not finite.
    """
    p = params
    near_nodes = np.empty(len(Y0))
    near_observations = np.empty(len(X))
    nearest_squared(Y0, X, near_nodes, near_observations)
    w = _weights(near_observations, p.prune_pre_px, p.soft_weights)
    kept = w > _TRUST_WEIGHT if p.soft_weights else near_observations < (3.0 * p.prune_pre_px) ** 2
    if kept.sum() < 3:
        return None
    X = np.ascontiguousarray(X[kept])
    near_observations = near_observations[kept]
    s = chain_coordinates(Y0, p.arc_length_parametrisation)
    distances = node_distances(Y0, s, p.geodesic_kernel)
    spacing_px = max(float(s[-1]) / (len(s) - 1), 1.0)
    sigma2_start = sigma2_px2 if p.sigma2_management else max(float(np.median(near_nodes)), 1.0)
    floor = p.sigma2_min_px2 if p.sigma2_management else 1e-6
    mu_motion = p.mu_motion if p.chain_laplacian else 0.0
    k_vis = p.k_vis_per_px if p.node_visibility else 0.0

    def em(beta_px: float, weights: FloatArray, prior: FloatArray, Y_prior: FloatArray) -> tuple[FloatArray, ...]:
        Y, P1, sigma2, _ = register_nodes(
            Y0, X, weights, mct_kernel(distances, beta_px), s, prior, Y_prior, sigma2_start, floor, p.lam, p.mu,
            spacing_px, mu_motion, k_vis, p.two_anchor_estep, p.iterations, p.tolerance_px,
        )  # fmt: skip
        return Y, P1, np.array(sigma2)

    none = np.zeros(len(Y0))
    Y_pre = Y0
    prior = none
    if p.two_pass:
        # Narrow kernel: each node goes to its nearest observations.
        Y_pre = em(p.beta_pre_px, _weights(near_observations, p.prune_pre_px, p.soft_weights), none, Y0)[0]
        if not np.isfinite(Y_pre).all():
            return None
        nearest_squared(Y_pre, X, near_nodes, near_observations)
        if p.correspondence_prior:
            prior = p.prior_weight * np.exp(-p.k_vis_per_px * np.sqrt(near_nodes))
    # Wide kernel: nodes are coupled, the shape stays smooth.
    Y, P1, sigma2 = em(p.beta_px, _weights(near_observations, p.prune_px, p.soft_weights), prior, Y_pre)
    if not np.isfinite(Y).all():
        return None
    nearest_squared(Y, X, near_nodes, near_observations)
    support = np.sqrt(near_nodes)
    residual = float(distance_to_curve(X, Y).mean())
    sigma2_out = float(sigma2)
    if p.sigma2_management:
        # Fit-tied cap, and the fixed bound from above (paper, "Noise variance management").
        sigma2_out = min(sigma2_out, residual**2 + p.epsilon_px2)
        sigma2_out = float(np.clip(sigma2_out, p.sigma2_min_px2, p.sigma2_max_px2))
    return Registration(Y, sigma2_out, residual, support, P1)


def respaced(nodes: FloatArray) -> FloatArray | None:
    """The same curve with equidistant nodes; None when it has no length to speak of or is not finite."""
    if not np.isfinite(nodes).all() or arc_length(nodes)[-1] < 1.0:
        return None
    return resample(nodes, len(nodes))


def _weights(squared: FloatArray, sigma_p_px: float, soft: bool) -> FloatArray:
    """w_n = exp(-d_n^2 / (2 sigma_p^2)) (paper); all 1 when soft weighting is off."""
    return np.exp(-squared / (2.0 * sigma_p_px**2)) if soft else np.ones(len(squared))
