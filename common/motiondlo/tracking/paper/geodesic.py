"""Arc length, the second-order MCT geodesic kernel, and the velocity warm start through it.

Legend: ``s`` (M,) arc length of the nodes, ``G`` (M, M) kernel, ``V`` (M, 2) node velocities.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from motiondlo.geometry.curve import arc_length

FloatArray = npt.NDArray[np.float64]


def chain_coordinates(nodes: FloatArray, by_arc_length: bool) -> FloatArray:
    """s (M,) of the nodes (paper, "Arc-length parametrization"): D_ij = |s_i - s_j|.

    With ``by_arc_length`` off, nodes are counted at the mean spacing instead.
    """
    s = arc_length(nodes)
    return s if by_arc_length else np.linspace(0.0, s[-1], len(nodes))


def node_distances(nodes: FloatArray, s: FloatArray, geodesic: bool) -> FloatArray:
    """(M, M) distances between nodes: along the chain, or straight (which couples folds that lie side by side)."""
    if geodesic:
        return np.abs(s[:, None] - s[None, :])
    gap = nodes[:, None, :] - nodes[None, :, :]
    return np.hypot(gap[..., 0], gap[..., 1])


def mct_kernel(distances: FloatArray, beta_px: float) -> FloatArray:
    """Second-order kernel of motion coherence theory (paper, "MCT geodesic kernel").

    G(d) = 1 / (4 beta^2) exp(-sqrt(2) |d| / beta) (2 |d| + sqrt(2) beta). distances: (M, M) px. Returns (M, M).
    """
    d = np.abs(distances)
    root2 = np.sqrt(2.0)
    kernel = np.exp(-root2 * d / beta_px) * (2.0 * d + root2 * beta_px) / (4.0 * beta_px**2)
    return np.asarray(kernel, dtype=np.float64)


def warm_start(nodes: FloatArray, displacement: FloatArray, kernel: FloatArray) -> FloatArray:
    """Y0 = Y + G~ V with the rows of G~ summing to one (paper, "Inter-frame velocity warm-start").

    nodes, displacement: (M, 2) px, the expected displacement since the last update. kernel: (M, M).
    """
    return np.asarray(nodes + (kernel / kernel.sum(axis=1, keepdims=True)) @ displacement, dtype=np.float64)


def updated_velocity(
    velocity: FloatArray, observed: FloatArray, supported: npt.NDArray[np.uint8], alpha_v: float
) -> FloatArray:
    """V <- alpha_v observed + (1 - alpha_v) V (paper, "Inter-frame velocity warm-start").

    velocity, observed: (M, 2) px/s. supported: (M,) 1 where a node had observations. The others have shown no motion of
    their own; they "receive motion information from nearby regions of the curve": the supported nodes' velocities,
    interpolated along the chain. Fed with their own prediction instead, they would fly on for ever.
    """
    v = alpha_v * observed + (1.0 - alpha_v) * velocity
    k = np.flatnonzero(supported)
    if 0 < len(k) < len(v):
        index = np.arange(len(v))
        v = np.stack([np.interp(index, k, v[k, 0]), np.interp(index, k, v[k, 1])], axis=1)
    return np.asarray(v, dtype=np.float64) if len(k) else np.zeros_like(v)
