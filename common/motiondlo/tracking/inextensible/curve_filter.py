"""The state of one DLO and its filter: pose, rates, constants, covariance, and the quantities at the stations."""

from __future__ import annotations

import numpy as np

from motiondlo.frames.types import FloatArray
from motiondlo.geometry.curve import arc_length
from motiondlo.tracking.inextensible.curve_kernels import acceleration_covariance, place_curve
from motiondlo.tracking.inextensible.end_rows import Rows
from motiondlo.tracking.inextensible.filter_kernels import (
    CONSTANTS,
    END_A,
    END_B,
    RATIO_A,
    STRETCH,
    keep_bend,
    place_stations,
    predict,
    solve,
)
from motiondlo.tracking.inextensible.params import InextensibleParams
from motiondlo.tracking.inextensible.row_kernels import remember_bend
from motiondlo.tracking.inextensible.shape import STRIDE, fit_pose, make_layout
from motiondlo.tracking.types import Correction

_FIELD_PX = 24.0
_ANGLE_FLOOR = 1.0
"""Inverse variance of angle coefficients, 1/rad^2: no field of places may leave them free."""
_START_CORRELATION_PX = 120.0
_LARGEST_SIGMA_PX = 80.0
GAP_MS = 20.0
"""Longer steps are no motion that could be predicted."""


class CurveFilter:
    """An extended Kalman filter over an inextensible curve (legend in :mod:`filter_kernels`)."""

    def __init__(self, correction: Correction, params: InextensibleParams) -> None:
        self.params = p = params
        length = float(arc_length(correction.nodes)[-1])
        self.layout = make_layout(length, correction.ends, params)
        q = fit_pose(self.layout, correction.nodes)
        n = self.n = len(q)
        size = self.size = 2 * n + CONSTANTS
        s = self.s_px = self.layout.stations_s_px
        m = self.m = len(s)
        self.x: FloatArray = np.zeros(size)
        self.x[:n] = q
        self.x[2 * n + RATIO_A :] = p.height_ratio
        self.theta: FloatArray = np.empty(self.layout.samples)
        self.points: FloatArray = np.empty((self.layout.samples, 2))
        self.jacobian: FloatArray = np.zeros((m, 2, n))
        self.p: FloatArray = np.empty((m, 2))
        self.th, self.kappa, self.vn, self.vt, self.omega, self.sn, self.sv = (np.zeros(m) for _ in range(7))
        self.h_normal, self.h_stretch = np.zeros((m, n)), np.zeros(m)
        capacity = m + 16
        self.rows = Rows(
            np.zeros((capacity, size)), np.zeros(capacity), np.zeros(capacity), np.zeros(capacity, np.uint8)
        )
        self._step = np.zeros(size)
        self._gain = np.zeros(size)
        self.place()
        every = max(1, round(_FIELD_PX / p.station_px))
        self._field = np.unique(np.append(np.arange(0, m, every), m - 1)).astype(np.int64)
        self._field_precision = self._precision(np.ones(len(self._field)), p.correlation_px, 1e-3)
        self._acceleration = np.zeros((n, n))
        self._refresh_acceleration()
        self.cov: FloatArray = self._first_covariance(correction, length)
        self._first_cov = self.cov.copy()
        self._constants_q = np.zeros(CONSTANTS)
        self._constants_q[STRETCH] = p.stretch_walk**2
        self._memory = np.zeros(n)
        remember_bend(n, self.x, 1.0, np.ones(m), self._memory)
        self._tick = 0
        self.locate()

    def _first_covariance(self, correction: Correction, length: float) -> FloatArray:
        """The first shape's own uncertainty, smooth along the DLO, and wider the further it is continued."""
        p = self.params
        n = self.n
        s = self.s_px[self._field]
        beyond = np.maximum(np.maximum(-s, s - length), 0.0)
        at = np.linspace(0.0, length, len(correction.nodes))
        spread = np.maximum(np.interp(s, at, correction.sigma_normal_px), 0.5) + 0.2 * beyond
        cov = np.zeros((self.size, self.size))
        precision = self._precision(spread, _START_CORRELATION_PX, 0.05)
        start = np.zeros((n, n))
        acceleration_covariance(self.jacobian, self._field, precision, _ANGLE_FLOOR, start)
        cov[:n, :n] = start
        cov[n : 2 * n, n : 2 * n] = self._acceleration * 0.02**2
        tips = np.maximum(correction.sigma_tangent_px[[0, -1]], p.tip_offset_sigma_px)
        for k, sd in ((STRETCH, p.stretch_sigma), (END_A, tips[0]), (END_B, tips[1])):
            cov[2 * n + k, 2 * n + k] = sd**2
        for k in range(2):
            cov[2 * n + RATIO_A + k, 2 * n + RATIO_A + k] = max(p.height_ratio_sigma, 1e-4) ** 2
        return cov

    def _precision(self, spread: FloatArray, correlation_px: float, nugget: float) -> FloatArray:
        s = self.s_px[self._field]
        r = np.sqrt(3.0) * np.abs(s[:, None] - s[None]) / correlation_px
        k = ((1.0 + r) * np.exp(-r) + nugget * np.eye(len(s))) * spread[:, None] * spread[None]
        return np.ascontiguousarray(np.linalg.inv(k))

    def _refresh_acceleration(self) -> None:
        acceleration_covariance(self.jacobian, self._field, self._field_precision, _ANGLE_FLOOR, self._acceleration)

    def place(self) -> None:
        """Evaluate the curve at the state."""
        layout = self.layout
        place_curve(
            self.x[: self.n], 1.0 + self.x[2 * self.n + STRETCH], layout.basis, layout.ds_px, layout.anchor, STRIDE,
            self.theta, self.points, self.jacobian,
        )  # fmt: skip

    def locate(self) -> None:
        """Evaluate the curve, and what the stations need of it."""
        self.place()
        place_stations(
            self.x, self.cov, self.n, self.points, self.theta, self.jacobian, STRIDE, self.layout.ds_px, self.p,
            self.th, self.kappa, self.vn, self.vt, self.omega, self.h_normal, self.h_stretch, self.sn, self.sv,
        )  # fmt: skip

    def advance(self, dt_ms: float, noise: float) -> None:
        """Predict by ``dt_ms`` with an acceleration noise of ``noise`` px^2/ms^3."""
        n = self.n
        if dt_ms > GAP_MS:
            # Nothing is known of so long a time: the shape may be anywhere near, and what it did is over.
            self.x[n : 2 * n] = 0.0
            self.cov += self._first_cov
            dt_ms = GAP_MS
        decay = float(np.exp(-dt_ms / self.params.velocity_decay_ms))
        if float(self.sn.max()) > _LARGEST_SIGMA_PX:
            # Out of sight for long: it is lost there already, more noise would only spoil the numbers.
            noise = 0.0
            decay = float(np.exp(-dt_ms / 20.0))
        predict(self.x, self.cov, n, dt_ms, decay, self._acceleration, noise, self._constants_q)
        self.locate()

    def absorb(self, dt_ms: float, alive: FloatArray) -> bool:
        """Update from the rows and the remembered bend; False if the numbers failed and the state was kept.

        alive: (m,) how surely every station is in view: only there the bend is learned.
        """
        p = self.params
        self._step[:] = 0.0
        keep_bend(
            self.n, dt_ms, self.x, self._memory, p.bend_sigma, p.bend_rate_sigma, self.cov, self._step, self._gain
        )
        done = self._solve()
        self.locate()
        if done:
            self._tick += 1
            if self._tick % 2 == 0:
                self._refresh_acceleration()
            remember_bend(self.n, self.x, p.bend_memory * dt_ms, alive, self._memory)
        return done

    def absorb_correction(self) -> bool:
        """Update from rows of a late correction; the bend is taken from the result."""
        self._step[:] = 0.0
        done = self._solve()
        self.locate()
        if done:
            remember_bend(self.n, self.x, 1.0, np.ones(self.m), self._memory)
        return done

    def _solve(self) -> bool:
        p = self.params
        rows = self.rows
        sound = bool(solve(
            self.cov, self._step, rows.h, rows.z, rows.w, rows.count, p.student_nu, p.robust_passes, rows.robust
        ))  # fmt: skip
        if sound:
            self.x += self._step
        if not sound:
            self.x[self.n : 2 * self.n] = 0.0
            self.cov[:] = self._first_cov
        return sound

    def widen_end(self, index: int, sigma_px: float) -> None:
        """Forget what is known of an end's offset: it was found anew."""
        k = 2 * self.n + END_A + index
        self.x[k] = 0.0
        self.cov[k, :] = 0.0
        self.cov[:, k] = 0.0
        self.cov[k, k] = sigma_px**2
