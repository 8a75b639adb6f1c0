"""The state of one DLO and its filter: pose, rates, constants, covariance, and the quantities at the stations."""

from __future__ import annotations

import numpy as np

from motiondlo.frames.types import EndKind, FloatArray
from motiondlo.geometry.curve import arc_length
from motiondlo.tracking.inextensible.arrays import Curve, Looks, Numbers, Places
from motiondlo.tracking.inextensible.curve_kernels import ANGLE_FLOOR, acceleration_covariance, place_curve
from motiondlo.tracking.inextensible.end_rows import Rows
from motiondlo.tracking.inextensible.filter_kernels import (
    CONSTANTS,
    END_A,
    END_B,
    RATIO_A,
    STRETCH,
    solve,
)
from motiondlo.tracking.inextensible.params import InextensibleParams
from motiondlo.tracking.inextensible.row_kernels import remember_bend
from motiondlo.tracking.inextensible.shape import STRIDE, fit_pose, make_layout
from motiondlo.tracking.inextensible.update_kernels import locate, take_in
from motiondlo.tracking.types import Correction

_FIELD_PX = 24.0
_START_CORRELATION_PX = 120.0
_BEND_PX = 3.0
"""How hard uneven rates are held against a start in motion."""
_VELOCITY_SIGMA_PX_MS = 0.5
"""Of a velocity that was known a moment ago."""
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
        self.x[2 * n + RATIO_A : 2 * n + RATIO_A + 2] = p.height_ratio
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
        self.place()
        every = max(1, round(_FIELD_PX / p.station_px))
        self._field = np.unique(np.append(np.arange(0, m, every), m - 1)).astype(np.int64)
        precision = self._precision(np.ones(len(self._field)), p.correlation_px, 1e-3)
        acceleration = np.zeros((n, n))
        acceleration_covariance(self.jacobian, self._field, precision, ANGLE_FLOOR, acceleration)
        self.cov: FloatArray = self._first_covariance(correction, length, acceleration)
        self._first_cov = self.cov.copy()
        if correction.velocity_px_s is not None:
            self._start_moving(correction.velocity_px_s, acceleration)
        walks = np.zeros(CONSTANTS)
        walks[STRETCH] = p.stretch_walk**2
        self.curve = Curve(
            self.x, self.cov, self.x.copy(), self.cov.copy(), np.zeros(size), np.zeros(size), self.layout.basis,
            self.theta, self.points, self.jacobian, acceleration, walks, self._field, precision, np.zeros(n),
            self.layout.ds_px, self.layout.anchor, STRIDE,
        )  # fmt: skip
        self.places = Places(
            s, self.p, self.th, self.kappa, self.vn, self.vt, self.omega, self.sn, self.sv, self.h_normal,
            self.h_stretch,
        )  # fmt: skip
        remember_bend(n, self.x, 1.0, np.ones(m), self.curve.memory)
        self._tick = 0
        self.locate()

    def _first_covariance(self, correction: Correction, length: float, acceleration: FloatArray) -> FloatArray:
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
        acceleration_covariance(self.jacobian, self._field, precision, ANGLE_FLOOR, start)
        cov[:n, :n] = start
        cov[n : 2 * n, n : 2 * n] = acceleration * 0.02**2
        offsets = [p.tip_offset_sigma_px if k is EndKind.TIP else p.patch_offset_sigma_px for k in correction.ends]
        for k, sd in ((STRETCH, p.stretch_sigma), (END_A, offsets[0]), (END_B, offsets[1])):
            cov[2 * n + k, 2 * n + k] = sd**2
        for k in range(2):
            cov[2 * n + RATIO_A + k, 2 * n + RATIO_A + k] = max(p.height_ratio_sigma, 1e-4) ** 2
        return cov

    def _start_moving(self, velocity_px_s: FloatArray, acceleration: FloatArray) -> None:
        """The rates (n,) under which the curve moves nearest to a velocity of the shape (M, 2)."""
        n = self.n
        at = np.linspace(0.0, self.layout.length_px, len(velocity_px_s))
        wanted = np.stack([np.interp(self.s_px, at, velocity_px_s[:, k]) for k in range(2)], axis=1) * 1e-3
        bend = np.zeros((n - 4, n))
        bend[:, 2:] = _BEND_PX * np.diff(np.eye(n - 2), 2, axis=0)
        design = np.vstack([self.jacobian.reshape(-1, n), bend])
        target = np.concatenate([wanted.reshape(-1), np.zeros(n - 4)])
        self.x[n : 2 * n] = np.linalg.lstsq(design, target, rcond=None)[0]
        self.cov[n : 2 * n, n : 2 * n] = acceleration * _VELOCITY_SIGMA_PX_MS**2

    def _precision(self, spread: FloatArray, correlation_px: float, nugget: float) -> FloatArray:
        s = self.s_px[self._field]
        r = np.sqrt(3.0) * np.abs(s[:, None] - s[None]) / correlation_px
        k = ((1.0 + r) * np.exp(-r) + nugget * np.eye(len(s))) * spread[:, None] * spread[None]
        return np.ascontiguousarray(np.linalg.inv(k))

    def place(self) -> None:
        """Evaluate the curve at the state."""
        layout = self.layout
        place_curve(
            self.x[: self.n], 1.0 + self.x[2 * self.n + STRETCH], layout.basis, layout.ds_px, layout.anchor, STRIDE,
            self.theta, self.points, self.jacobian,
        )  # fmt: skip

    def locate(self) -> None:
        """Evaluate the curve, and what the stations need of it."""
        locate(self.curve, self.places, self.n)

    def bridge(self, dt_ms: float) -> float:
        """Prepare for a prediction by ``dt_ms``; returns for how long it is to be."""
        if dt_ms <= GAP_MS:
            return dt_ms
        # Nothing is known of so long a time: the shape may be anywhere near, and what it did is over.
        self.x[self.n : 2 * self.n] = 0.0
        self.cov += self._first_cov
        return GAP_MS

    def absorb(self, dt_ms: float, looks: Looks, numbers: Numbers) -> tuple[int, float, float] | None:
        """Update from the rows and the remembered bend.

        Returns (stations seen, median squared innovation, RMS offset px), or None if the numbers failed and the place
        was kept.
        """
        self._tick += 1
        sound, seen, median, fit_px = take_in(
            self.curve, self.places, looks, self.rows.arrays, numbers, self.n, self.rows.count, dt_ms,
            self._tick % 2 == 0,
        )  # fmt: skip
        if not sound:
            self._start_anew()
            return None
        return int(seen), float(median), float(fit_px)

    def absorb_correction(self, fresh: bool) -> bool:
        """Update from rows of a late correction; the remembered bend follows by the share that it told us.

        fresh: whether its errors are others than those of the last one. A DLO at rest shows the same picture again, and
        its shape is no second opinion: the place follows, but is not known any better.
        """
        p = self.params
        rows = self.rows
        step = self.curve.step
        step[:] = 0.0
        before, kept = self.sn.copy(), self.cov.copy()
        if not solve(self.cov, step, rows.h, rows.z, rows.w, rows.count, p.student_nu, p.robust_passes, rows.robust):
            self._start_anew()
            return False
        self.x += step
        self.locate()
        told = np.clip(1.0 - (self.sn / np.maximum(before, 1e-9)) ** 2, 0.0, 1.0)
        remember_bend(self.n, self.x, 1.0, told, self.curve.memory)
        if not fresh:
            self.cov[:] = kept
            self.locate()
        return True

    def _start_anew(self) -> None:
        """Keep the place, forget motion and certainty: the numbers failed."""
        self.x[self.n : 2 * self.n] = 0.0
        self.cov[:] = self._first_cov
        self.locate()

    def widen_end(self, index: int, sigma_px: float) -> None:
        """Forget what is known of an end's offset: it was found anew."""
        k = 2 * self.n + END_A + index
        self.x[k] = 0.0
        self.cov[k, :] = 0.0
        self.cov[:, k] = 0.0
        self.cov[k, k] = sigma_px**2
