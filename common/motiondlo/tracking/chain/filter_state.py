"""The Kalman filter of one chain: its state, its motion model, its soft constraints."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from motiondlo.tracking.chain import filter_kernels
from motiondlo.tracking.chain.layout import Layout, acceleration_kernel, start_covariance
from motiondlo.tracking.chain.params import ChainParams
from motiondlo.tracking.chain.spline import weights
from motiondlo.tracking.types import Correction

FloatArray = npt.NDArray[np.float64]

EXTRAS_PER_END = 3
"""Filter states of an end: offset of the patch along the outward tangent and the left normal (px), height ratio."""

_LONGEST_STEP_MS = 5.0
_FULL_NOISE_PX_MS = 5.0
_MOST_BOOST = 30.0
_SLIDE_MS = 4.0
_MOST_VELOCITY_VARIANCE = 9.0


class ChainFilter:
    """State x: places and velocities of the K control nodes, three extras of either end, common scale of lengths."""

    def __init__(self, layout: Layout, correction: Correction, params: ChainParams) -> None:
        self.params = params
        self.K = K = layout.K
        self.span_px = layout.span_px
        n = 4 * K + 2 * EXTRAS_PER_END + 1
        self.x = np.zeros(n)
        self.x[:K], self.x[K : 2 * K] = layout.nodes[:, 0], layout.nodes[:, 1]
        self.kernel = acceleration_kernel(layout, params)
        self.P = np.zeros((n, n))
        self.P[: 4 * K, : 4 * K] = start_covariance(layout, correction, self.kernel)
        self.P[-1, -1] = params.scale_sigma**2
        self.row = np.zeros(n)
        """Scratch of the scalar updates."""
        self.boost = 1.0
        """Factor of the process noise: grows with surprise."""
        self.failures = 0
        # Lengths are kept at the knots and half way between them.
        self._length_j0, _, self._length_w1, _ = weights(np.arange(0.0, K - 3 + 0.25, 0.5), K)
        self._own_shape = np.zeros(K)
        filter_kernels.bends(self.x, K, self._own_shape)
        self._shape = np.zeros(K)
        self._x_before = self.x.copy()
        self._P_before = self.P.copy()
        self._updates = 0

    def extras(self, which: int) -> int:
        """Index of the first extra of end 0 or 1."""
        return 4 * self.K + EXTRAS_PER_END * which

    def nodes(self) -> FloatArray:
        """(K, 2) control nodes."""
        return np.stack([self.x[: self.K], self.x[self.K : 2 * self.K]], axis=1)

    def variance_of(self, index: npt.NDArray[np.int64], h: FloatArray, count: int) -> float:
        """h P h' of a row with ``count`` entries."""
        return float(filter_kernels.row_variance(self.P, index, h, count))

    def absorb(self, index: npt.NDArray[np.int64], h: FloatArray, count: int, innovation: float, R: float) -> None:
        """One scalar measurement."""
        filter_kernels.update(self.x, self.P, index, h, count, innovation, R, self.row)

    def predict(self, dt_ms: float, speed_px_ms: float, resting: bool) -> None:
        """Motion model; a gap in the batches is bridged in short steps, until all velocities have died away."""
        p = self.params
        np.copyto(self._x_before, self.x)
        np.copyto(self._P_before, self.P)
        least = p.accel_noise_rest if resting else p.accel_noise_onset
        q = p.accel_noise * max(least, min(speed_px_ms / _FULL_NOISE_PX_MS, 1.5)) * self.boost
        left = min(dt_ms, 3.0 * p.velocity_decay_ms)
        while left > 1e-9:
            step = min(left, _LONGEST_STEP_MS)
            decay = float(np.exp(-step / p.velocity_decay_ms))
            filter_kernels.predict(self.x, self.P, self.K, step, decay, self.kernel, q)
            filter_kernels.limit_velocity_variance(self.P, self.K, _MOST_VELOCITY_VARIANCE)
            left -= step
        # The common scale wanders about zero: perspective and height change it by about a percent, never by more.
        keep = float(np.exp(-dt_ms / p.scale_memory_ms))
        self.x[-1] *= keep
        self.P[-1, :] *= keep
        self.P[:, -1] *= keep
        self.P[-1, -1] += p.scale_sigma**2 * (1.0 - keep * keep)

    def adapt(self, dt_ms: float, nis: FloatArray, surprise: float) -> None:
        """More process noise while innovations exceed what the filter expects.

        nis: normalised innovations squared of the stations, 0 where there was none; surprise: the largest of an end.
        """
        seen = nis[nis > 0.0]
        if surprise > 4.0 or (len(seen) >= 3 and float(np.median(seen)) > 1.5):
            self.boost = min(self.boost * 2.0**dt_ms, _MOST_BOOST)
        elif len(seen) >= 3:
            self.boost = max(1.0, self.boost * 0.93**dt_ms)

    def constrain(self, dt_ms: float) -> None:
        """Soft inextensibility, and a weak bending prior about the chain's own, slowly adapting shape."""
        p = self.params
        x, P, K, row = self.x, self.P, self.K, self.row
        R = p.length_sigma_px**2 / dt_ms
        filter_kernels.keep_length(x, P, K, self._length_j0, self._length_w1, self.span_px, R, row)
        filter_kernels.keep_shape(self.x, self.P, self.K, self._own_shape, p.bend_sigma_px**2 / dt_ms, self.row)
        filter_kernels.bends(self.x, self.K, self._shape)
        self._own_shape += (1.0 - (1.0 - p.bend_memory) ** dt_ms) * (self._shape - self._own_shape)

    def slide(self, way_px: float, dt_ms: float) -> None:
        """Nothing measured the place along the DLO: all nodes may have slid by ``way_px`` along their own tangents.

        Errors of one update last for some: their sum over a millisecond or so counts, not that of their squares.
        """
        K = self.K
        x, y = np.gradient(self.x[:K]), np.gradient(self.x[K : 2 * K])
        mode = np.concatenate([x, y]) * (way_px / self.span_px)
        self.P[: 2 * K, : 2 * K] += np.multiply.outer(mode, mode) * max(1.0, _SLIDE_MS / dt_ms)

    def stop(self, back_ms: float) -> None:
        """At rest from now on, where the chain was ``back_ms`` ago."""
        K = self.K
        self.x[: 2 * K] -= self.x[2 * K : 4 * K] * back_ms
        self.x[2 * K : 4 * K] = 0.0

    def keep_sound(self) -> bool:
        """Numbers that fail (a covariance that is none any more) do not end the track: the state before stays.

        Returns whether the numbers were sound.
        """
        K, P = self.K, self.P
        self._updates += 1
        if self._updates % 64 == 0:
            # The updates keep P symmetric but for rounding.
            P[:] = 0.5 * (P + P.T)
        diagonal = np.diagonal(P)
        if np.isfinite(self.x).all() and np.isfinite(diagonal).all() and float(diagonal.min()) >= 0.0:
            return True
        self.failures += 1
        np.copyto(self.x, self._x_before)
        np.copyto(P, self._P_before)
        self.x[2 * K : 4 * K] = 0.0
        P[np.arange(2 * K), np.arange(2 * K)] += 4.0
        self.boost = 1.0
        return False
