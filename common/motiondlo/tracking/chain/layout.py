"""From a frame's polyline to a chain: control nodes, what it is continued by, how uncertain all that is at first."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from motiondlo.frames.types import EndKind
from motiondlo.geometry.curve import arc_length
from motiondlo.tracking.chain.params import ChainParams
from motiondlo.tracking.chain.spline import fit
from motiondlo.tracking.types import Correction

FloatArray = npt.NDArray[np.float64]

_BIAS_LENGTH_PX = 150.0
"""Arc length over which the homography's error changes."""
_BIAS_VARIANCE_PX2 = 1.5
_TURN_RAD = 0.06
_BEND_PER_PX = 6e-4


@dataclass(frozen=True)
class Layout:
    """A chain's extent. Material coordinates: ``u`` counts node distances from the chain's start, ``s`` px from the
    first node of the frame's polyline."""

    nodes: FloatArray
    """(K, 2) control nodes."""
    span_px: float
    """Arc length per unit of u."""
    before_px: float
    """How far the chain goes on before the polyline's first node."""
    after_px: float
    length_px: float
    """Of the polyline."""

    @property
    def K(self) -> int:
        """Number of control nodes."""
        return len(self.nodes)

    def u(self, s_px: FloatArray | float) -> FloatArray:
        """u of arc lengths ``s``."""
        return np.asarray((np.asarray(s_px) + self.before_px) / self.span_px, dtype=np.float64)


def lay_out(correction: Correction, params: ChainParams) -> Layout:
    """Control nodes through the polyline, and past its ends where the DLO goes on unseen."""
    nodes = np.asarray(correction.nodes, dtype=np.float64)
    length = float(arc_length(nodes)[-1])
    before, after = (_extension(kind, params) for kind in correction.ends)
    total = length + before + after
    spans = int(np.clip(round(total / params.knot_px), 4, params.max_nodes - 3))
    line = _extended(nodes, length, before, after)
    return Layout(fit(line, total, spans + 3), total / spans, before, after, length)


def _extension(kind: EndKind, params: ChainParams) -> float:
    if kind is EndKind.HELD:
        return params.held_cover_max_px
    return params.border_extension_px if kind is EndKind.BORDER else 0.0


def _extended(nodes: FloatArray, length: float, before: float, after: float) -> FloatArray:
    """The polyline with straight pieces along its end tangents, taken from chords of about 30 px."""
    chord = int(np.clip(round(len(nodes) * 30.0 / max(length, 1.0)), 2, len(nodes) - 1))
    parts = [nodes]
    if before > 0.0:
        t = nodes[0] - nodes[chord]
        parts.insert(0, nodes[0] + np.arange(before, 0.0, -5.0)[:, None] * t / np.hypot(*t))
    if after > 0.0:
        t = nodes[-1] - nodes[-chord - 1]
        steps = np.append(np.arange(5.0, after, 5.0), after)
        parts.append(nodes[-1] + steps[:, None] * t / np.hypot(*t))
    return np.concatenate(parts)


def acceleration_kernel(layout: Layout, params: ChainParams) -> FloatArray:
    """(K, K) correlation of accelerations along the arc: Matern, second order, as the paper's geodesic kernel."""
    r = np.sqrt(3.0) * _gaps(layout) / params.accel_length_px
    return np.asarray((1.0 + r) * np.exp(-r) + 1e-3 * np.eye(layout.K), dtype=np.float64)


def start_covariance(layout: Layout, correction: Correction, kernel: FloatArray) -> FloatArray:
    """(4 K, 4 K) covariance of places and velocities, x before y."""
    K = layout.K
    s = (np.arange(K) - 1.0) * layout.span_px - layout.before_px
    bias = _BIAS_VARIANCE_PX2 * np.exp(-0.5 * (_gaps(layout) / _BIAS_LENGTH_PX) ** 2)
    node_s = np.linspace(0.0, layout.length_px, len(correction.sigma_normal_px))
    sigma = np.interp(s, node_s, correction.sigma_normal_px)
    place = bias + 0.3 * np.diag(sigma**2)
    # What was never seen may turn and bend about the last place that was.
    for beyond in (np.maximum(-s, 0.0), np.maximum(s - layout.length_px, 0.0)):
        for mode in (_TURN_RAD * beyond, _BEND_PER_PX * beyond**2):
            place = place + np.outer(mode, mode)
    P = np.zeros((4 * K, 4 * K))
    for a in range(2):
        P[a * K : (a + 1) * K, a * K : (a + 1) * K] = place
        P[(2 + a) * K : (3 + a) * K, (2 + a) * K : (3 + a) * K] = 0.01 * kernel
    # The whole shape may be shifted along itself: a frame shows an end only to some pixels.
    along = np.gradient(layout.nodes, axis=0)
    along /= np.maximum(np.hypot(along[:, 0], along[:, 1]), 1e-9)[:, None]
    slide = float(np.median(correction.sigma_tangent_px)) * along.T.reshape(-1)
    P[: 2 * K, : 2 * K] += np.outer(slide, slide)
    return P


def _gaps(layout: Layout) -> FloatArray:
    k = np.arange(layout.K)
    return np.asarray(np.abs(k[:, None] - k[None, :]) * layout.span_px, dtype=np.float64)
