"""An end of a chain in the filter's present state, and the buffers for its events."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from motiondlo.tracking.chain import filter_kernels, patch_kernels
from motiondlo.tracking.chain.filter_state import ChainFilter
from motiondlo.tracking.chain.spline import weights

FloatArray = npt.NDArray[np.float64]
F4 = npt.NDArray[np.float32]

SEARCH_PAD_PX = 24
STEP_HALF_PX = 30


@dataclass
class PatchScratch:
    """Buffers that the ends and marks of a chain share."""

    a: FloatArray = field(default_factory=lambda: np.zeros(patch_kernels.MAX_EVENTS))
    d: FloatArray = field(default_factory=lambda: np.zeros(patch_kernels.MAX_EVENTS))
    p: npt.NDArray[np.int64] = field(default_factory=lambda: np.zeros(patch_kernels.MAX_EVENTS, np.int64))
    age: FloatArray = field(default_factory=lambda: np.zeros(patch_kernels.MAX_EVENTS))
    score: F4 = field(default_factory=lambda: np.zeros((2 * SEARCH_PAD_PX + 1, 2 * SEARCH_PAD_PX + 1), np.float32))
    second: F4 = field(default_factory=lambda: np.zeros((2 * SEARCH_PAD_PX + 1, 2 * SEARCH_PAD_PX + 1), np.float32))
    counts: FloatArray = field(default_factory=lambda: np.zeros(2 * STEP_HALF_PX + 1))
    out: FloatArray = field(default_factory=lambda: np.zeros(7))


@dataclass
class EndView:
    """Everything that the measurement of an end needs."""

    point: FloatArray
    """(2,) px."""
    outward: FloatArray
    """(2,) unit tangent away from the chain."""
    normal: FloatArray
    """(2,) left normal of the chain's own direction."""
    velocity: FloatArray
    """(2,) px/ms."""
    stretch: float
    """px per unit of u."""
    nodes: npt.NDArray[np.int64]
    """(4,) control nodes that the end depends on."""
    w: FloatArray
    """(4,) their weights."""
    w1: FloatArray
    """(4,) derivatives of the weights by u."""
    rotation: float
    """rad/ms."""
    sigma_v: float
    """px/ms, the larger of both directions."""

    @property
    def speed(self) -> float:
        """px/ms."""
        return float(np.hypot(self.velocity[0], self.velocity[1]))


def view_end(f: ChainFilter, u: float, sign: float) -> EndView:
    """The chain at ``u``; sign: +1 where the chain ends there, -1 where it begins."""
    x, K = f.x, f.K
    j0, w, w1, w2 = weights(np.array([u]), K)
    g = np.zeros((1, 10))
    cov = np.zeros((1, 3))
    filter_kernels.place(x, K, j0, w, w1, w2, g)
    filter_kernels.place_covariance(f.P, K, j0, w, cov, True)
    tangent, stretch = g[0, 2:4], float(g[0, 9])
    normal = np.array([-tangent[1], tangent[0]])
    nodes = np.arange(4) + j0[0]
    turn = np.array([w1[0] @ x[2 * K + nodes], w1[0] @ x[3 * K + nodes]])
    return EndView(
        point=g[0, :2],
        outward=sign * tangent,
        normal=normal,
        velocity=g[0, 4:6],
        stretch=stretch,
        nodes=nodes,
        w=w[0],
        w1=w1[0],
        rotation=float(normal @ turn) / stretch,
        sigma_v=float(np.sqrt(max(cov[0, 0], cov[0, 2], 0.0))),
    )


def within(point: FloatArray, last: npt.NDArray[np.int64], rim_px: float) -> bool:
    """Whether a point lies on the sensor of the surface ``last`` (2, H, W), at least ``rim_px`` from its border."""
    height, width = last.shape[1:]
    return bool(rim_px <= point[0] < width - rim_px and rim_px <= point[1] < height - rim_px)
