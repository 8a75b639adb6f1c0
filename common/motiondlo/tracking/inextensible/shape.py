"""The spline of a DLO: which coefficients, samples and stations it has, and how a polyline becomes one."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from motiondlo.frames.types import EndKind, FloatArray
from motiondlo.geometry.curve import arc_length, point_at
from motiondlo.tracking.inextensible.curve_kernels import place_curve
from motiondlo.tracking.inextensible.params import InextensibleParams

STRIDE = 2
"""Curve samples per station."""


@dataclass(frozen=True)
class Layout:
    """Material coordinates of a DLO: s = 0 is the first node of the shape it was started from."""

    s_lo_px: float
    ds_px: float
    basis: FloatArray
    """(S, K) cubic B-splines at the samples."""
    anchor: int
    """Sample that is the anchor (a station)."""
    length_px: float
    """Arc length of the shape it was started from."""

    @property
    def samples(self) -> int:
        """Samples of the curve, S."""
        return len(self.basis)

    @property
    def coefficients(self) -> int:
        """Spline coefficients, K."""
        return int(self.basis.shape[1])

    @property
    def stations_s_px(self) -> FloatArray:
        """(m,) material coordinates of the stations."""
        s = self.s_lo_px + np.arange(0, self.samples, STRIDE) * self.ds_px
        return np.asarray(s, dtype=np.float64)


def end_reach_px(kind: EndKind, params: InextensibleParams) -> float:
    """How far the curve is continued beyond an end of the first shape."""
    if kind is EndKind.BORDER:
        return params.border_reach_px
    if kind is EndKind.HELD:
        return params.held_reach_px
    if kind is EndKind.TIP:
        return 0.5 * params.station_px
    return params.hidden_reach_px


def cubic_basis(at: FloatArray, knots: FloatArray) -> FloatArray:
    """(S, K) cubic B-splines over K + 4 knots at S places within them, by the recursion of Cox and de Boor.

    Not scipy's: importing it takes a fifth of the time that a tracker needs to start.
    """
    basis = ((knots[:-1] <= at[:, None]) & (at[:, None] < knots[1:])).astype(np.float64)
    for degree in range(1, 4):
        rise, fall = knots[degree:-1] - knots[: -degree - 1], knots[degree + 1 :] - knots[1:-degree]
        up = np.divide(at[:, None] - knots[: -degree - 1], rise, out=np.zeros((len(at), len(rise))), where=rise > 0)
        down = np.divide(knots[degree + 1 :] - at[:, None], fall, out=np.zeros((len(at), len(fall))), where=fall > 0)
        basis = up * basis[:, :-1] + down * basis[:, 1:]
    return np.ascontiguousarray(basis)


def make_layout(length_px: float, ends: tuple[EndKind, EndKind], params: InextensibleParams) -> Layout:
    """Samples and basis for a DLO of a length, continued beyond its ends as their kinds ask for."""
    before, after = end_reach_px(ends[0], params), end_reach_px(ends[1], params)
    total = before + length_px + after
    stations = max(8, int(np.ceil(total / params.station_px)) + 1)
    samples = STRIDE * (stations - 1) + 1
    count = int(np.clip(round(total / params.knot_px) + 3, 7, params.max_coefficients))
    knots = np.concatenate([np.zeros(3), np.linspace(0.0, 1.0, count - 2), np.ones(3)])
    at = np.clip(np.linspace(0.0, 1.0, samples), 0.0, 1.0 - 1e-12)
    basis = cubic_basis(at, knots)
    ds = total / (samples - 1)
    middle = round((before + 0.5 * length_px) / (STRIDE * ds)) * STRIDE
    return Layout(-before, ds, basis, int(np.clip(middle, 0, samples - 1)), length_px)


def fit_pose(layout: Layout, nodes: FloatArray) -> FloatArray:
    """The pose (n,) whose curve is nearest to a polyline (M, 2) at equal arc lengths; straight beyond its ends."""
    length = float(arc_length(nodes)[-1])
    chord = min(30.0, 0.4 * length)
    scale = length / layout.length_px
    s = np.asarray((layout.s_lo_px + np.arange(layout.samples) * layout.ds_px) * scale, dtype=np.float64)
    targets = point_at(nodes, s)
    ends = point_at(nodes, np.array([0.0, chord, length - chord, length]))
    first, last = ends[1] - ends[0], ends[3] - ends[2]
    targets += np.minimum(s, 0.0)[:, None] * (first / np.hypot(*first))
    targets += np.maximum(s - length, 0.0)[:, None] * (last / np.hypot(*last))
    steps = np.gradient(targets, axis=0)
    angles = np.unwrap(np.arctan2(steps[:, 1], steps[:, 0]))
    k_count = layout.coefficients
    second = np.diff(np.eye(k_count), 2, axis=0)
    design = np.vstack([layout.basis, 0.05 * second])
    n = 2 + k_count
    q = np.zeros(n)
    q[2:] = np.linalg.lstsq(design, np.concatenate([angles, np.zeros(k_count - 2)]), rcond=None)[0]
    q[:2] = targets[layout.anchor]
    theta = np.empty(layout.samples)
    points = np.empty((layout.samples, 2))
    stations = (layout.samples - 1) // STRIDE + 1
    jacobian = np.zeros((stations, 2, n))
    penalty = np.zeros((k_count - 2, n))
    penalty[:, 2:] = 3.0 * second
    for _ in range(8):
        place_curve(q, 1.0, layout.basis, layout.ds_px, layout.anchor, STRIDE, theta, points, jacobian)
        error = (targets - points)[::STRIDE].reshape(-1)
        system = np.vstack([jacobian.reshape(-1, n), penalty])
        residual = np.concatenate([error, -penalty @ q])
        q = q + np.linalg.solve(system.T @ system, system.T @ residual)
    return q
