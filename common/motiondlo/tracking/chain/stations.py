"""The places along a chain where events are looked for: what they should show, what they showed, and since when."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from motiondlo.events.types import SensorGeometry
from motiondlo.frames.types import EndKind
from motiondlo.tracking.chain import filter_kernels, near_kernels, profile_kernels
from motiondlo.tracking.chain.filter_state import ChainFilter
from motiondlo.tracking.chain.layout import Layout
from motiondlo.tracking.chain.params import ChainParams
from motiondlo.tracking.chain.spline import weights
from motiondlo.tracking.chain.templates import profile_bins, profile_densities, seen_in_frame
from motiondlo.tracking.types import Correction

FloatArray = npt.NDArray[np.float64]
BoolArray = npt.NDArray[np.bool_]
Surface = npt.NDArray[np.int64]

# Places along a station's tangent, to either side of it, at which its normal is searched.
_LINES = 3
_LINE_PX = 3.0
_RIM_PX = 4.0
_WATCH_US = 4000
_FLIP_PX_MS = 0.4
_DOUBTFUL_LEAD = 3.0
_FULL_SUPPORT_MS = 10.0
_SUPPORTED_MS = 5.0
_VELOCITIES_KEPT = 4


class Stations:
    """S stations of one chain."""

    def __init__(
        self, layout: Layout, correction: Correction, radius_px: float, params: ChainParams, geometry: SensorGeometry
    ) -> None:
        self.params = params
        self.geometry = geometry
        self.radius_px = radius_px
        # On what was seen, and on what it is continued by beyond the border: that may come into view.
        s0 = -layout.before_px if correction.ends[0] is EndKind.BORDER else 0.0
        s1 = layout.length_px + (layout.after_px if correction.ends[1] is EndKind.BORDER else 0.0)
        S = max(5, round((s1 - s0) / params.station_px) + 1)
        margin = min(8.0, 0.2 * (s1 - s0))
        s = np.linspace(s0 + margin, s1 - margin, S)
        self.count = S
        self.u = layout.u(s)
        self.j0, self.w, self.w1, self.w2 = weights(self.u, layout.K)
        self.g = np.zeros((S, 10))
        """Geometry as of ``filter_kernels.place``."""
        self.out = np.zeros((S, 8))
        """Matches as of ``profile_kernels.match_profiles``."""
        self.use = np.zeros(S, np.bool_)
        """Matches that were absorbed."""
        self.nis = np.zeros(S)
        self.exists = np.ones(S, np.bool_)
        """Cleared beyond an end of the DLO that was found."""
        self.inside = np.zeros(S, np.bool_)
        self.foreign = np.zeros(S, np.bool_)
        """Where events may belong to another moving DLO."""
        self.any_foreign = False
        self.seen_ms = np.zeros(S)
        self.cov_place = np.zeros((S, 3))
        self._cov_velocity = np.zeros((S, 3))
        self._vn_past = np.zeros((_VELOCITIES_KEPT, S))
        self._build_profiles(layout, correction, s)
        self.support_ms = np.zeros(S)
        self._seen_at_start = seen_in_frame(correction.appearance, s, radius_px, params.station_px)
        self._seen_at_start &= (s > -8.0) & (s < layout.length_px + 8.0)

    def _build_profiles(self, layout: Layout, correction: Correction, s: FloatArray) -> None:
        p = self.params
        half = profile_bins(self.radius_px)
        density = profile_densities(
            correction.appearance, np.clip(s, 0.0, layout.length_px), self.radius_px, half, p.station_px
        )
        self._anchor = np.ascontiguousarray(density, dtype=np.float32)
        self._density = self._anchor.copy()
        bins = 2 * half + 1
        self._floor = 0.5 / bins
        self._table = np.log((self._anchor + np.float32(self._floor)) / np.float32(2.0 * self._floor))
        self._hist = np.zeros((self.count, 2, bins + 4 * int(p.band_max_px) + 8), np.float32)
        self._score = np.zeros((2, 4 * int(p.band_max_px) + 5), np.float32)
        self._ev_bin = np.zeros(profile_kernels.MAX_EVENTS, np.int64)
        self._ev_age = np.zeros(profile_kernels.MAX_EVENTS)
        self._ev_sign = np.zeros(profile_kernels.MAX_EVENTS, np.int64)

    def start(self, f: ChainFilter) -> None:
        """Place the stations for the first time; what the frame shows there supports them."""
        self.place(f)
        self.look_inside()
        self.support_ms[self.inside & self._seen_at_start] = _FULL_SUPPORT_MS

    def place(self, f: ChainFilter) -> None:
        """Geometry from the filter's state."""
        filter_kernels.place(f.x, f.K, self.j0, self.w, self.w1, self.w2, self.g)

    def look_inside(self) -> None:
        """Which stations lie in the image."""
        x, y = self.g[:, 0], self.g[:, 1]
        self.inside[:] = (x > _RIM_PX) & (y > _RIM_PX)
        self.inside &= (x < self.geometry.width_px - 1 - _RIM_PX) & (y < self.geometry.height_px - 1 - _RIM_PX)

    def look_around(self, grid: npt.NDArray[np.uint32], bit: int) -> None:
        """Which stations lie where another DLO moves (``near_kernels``)."""
        self.any_foreign = near_kernels.marked_by_others(grid, self.g, bit, self.foreign) > 0

    def activity(self, last: Surface, t_us: int) -> int:
        """Events of the last milliseconds on one line across every station: the cheap look at a resting DLO."""
        watched = self.inside & self.exists & ~self.foreign
        return int(profile_kernels.activity(last, t_us, t_us - _WATCH_US, self.g, self.radius_px + 6.0, watched))

    def measure(self, f: ChainFilter, last: Surface, t_us: int, dt_ms: float, resting: bool) -> None:
        """Match all profiles about the predicted chain, and absorb the offsets along the normals."""
        p, g, out = self.params, self.g, self.out
        self.place(f)
        filter_kernels.place_covariance(f.P, f.K, self.j0, self.w, self.cov_place, False)
        filter_kernels.place_covariance(f.P, f.K, self.j0, self.w, self._cov_velocity, True)
        self.look_inside()
        sigma_n = np.sqrt(np.maximum(normal_part(self.cov_place, g), 1e-6))
        sigma_v = np.sqrt(np.maximum(normal_part(self._cov_velocity, g), 1e-6))
        band = np.clip(2.5 * sigma_n + p.band_px, p.band_px, p.band_max_px)
        accel = (g[:, 6] - self._vn_past[0]) / (_VELOCITIES_KEPT * dt_ms)
        active = self.inside & self.exists
        profile_kernels.match_profiles(
            last, t_us, p.latency_us * 1e-3, g, sigma_v, accel, band, active, self._table, _LINES, _LINE_PX,
            p.window_px, p.window_min_ms, p.window_max_ms, p.window_accel_px, p.target_events, p.min_events,
            _FLIP_PX_MS, self._hist, out, self._score, self._ev_bin, self._ev_age, self._ev_sign,
        )  # fmt: skip
        use = self.use
        use[:] = (out[:, 1] > 0.0) & (out[:, 2] > p.min_mean_llr)
        if self.any_foreign and resting:
            # Another DLO moves by: one at rest needs more than a few stations to be moved as well.
            use &= ~self.foreign
            if use.sum() < max(3, 0.2 * (active & ~self.foreign).sum()):
                use[:] = False
        # Events that are used again are no new information.
        reuse = np.maximum(1.0, out[:, 5] / dt_ms)
        doubt = np.where(out[:, 6] < _DOUBTFUL_LEAD, 4.0, 1.0)
        R = (p.sigma_floor_px**2 + 2.0 * out[:, 1] ** 2 * doubt + (0.2 * out[:, 4] ** 2) ** 2) * reuse
        self.nis[:] = 0.0
        before = g[:, :2].copy()
        offset, age = np.ascontiguousarray(out[:, 0]), p.age_gain * out[:, 4]
        filter_kernels.measure_normals(
            f.x, f.P, f.K, self.j0, self.w, g, offset, R, age, use, p.gate_sigma, self.nis, f.row
        )
        self.place(f)
        self._learn(before, dt_ms)

    def _learn(self, before: FloatArray, dt_ms: float) -> None:
        p, g = self.params, self.g
        moved = g[:, :2] - before
        shift = moved[:, 1] * g[:, 2] - moved[:, 0] * g[:, 3]
        learn = self.use & (self.nis < 4.0) & (np.abs(g[:, 6]) > 0.3)
        profile_kernels.learn_profiles(
            self._hist, shift, learn, p.learn_rate * min(dt_ms, 2.0), self._density, self._anchor, p.learn_anchor,
            self._floor, self._table,
        )  # fmt: skip

    def hold(self, f: ChainFilter, where: BoolArray, R: float, both: bool) -> None:
        """Zero velocity with variance R at ``where`` (S,): along the normals, and with ``both`` along the tangents."""
        filter_kernels.rest_normals(f.x, f.P, f.K, self.j0, self.w, self.g, where, R, both, f.row)

    def keep_velocities(self) -> None:
        """Remember the normal velocities: accelerations shorten the windows."""
        self._vn_past[:-1] = self._vn_past[1:]
        self._vn_past[-1] = self.g[:, 6]

    def count_support(self, dt_ms: float) -> None:
        """How long every station has been supported by events; what should show motion and does not loses it."""
        found, vn = self.out[:, 3], np.abs(self.g[:, 6])
        self.seen_ms[self.use] += dt_ms
        self.support_ms[~self.inside] = 0.0
        self.support_ms[self.use] = np.minimum(self.support_ms[self.use] + dt_ms, _FULL_SUPPORT_MS)
        vanished = (found >= 0) & (found < self.params.min_events) & (vn > 0.7)
        self.support_ms[vanished] = np.maximum(self.support_ms[vanished] - dt_ms, 0.0)

    def silent(self) -> BoolArray:
        """(S,) where no events of a part known to be visible say that it does not move along its normal."""
        found = self.out[:, 3]
        quiet = self.inside & (found >= 0) & (found < self.params.min_events)
        return np.asarray(quiet & (np.abs(self.g[:, 6]) < 0.5) & (self.support_ms >= _SUPPORTED_MS))

    def all_silent(self) -> bool:
        """Whether nearly nothing that can be seen makes events."""
        found = self.out[:, 3]
        looked = self.inside & (found >= 0) & ~self.foreign
        quiet = looked & (found < self.params.min_events)
        return bool(self.use.sum() <= 1 and looked.sum() >= 4 and quiet.sum() > 0.8 * looked.sum())

    def supported(self, u: FloatArray) -> BoolArray:
        """Whether the places ``u`` (M,) were supported by data lately."""
        support = np.where(self.inside, self.support_ms, 0.0)
        return np.asarray(np.interp(u, self.u, support) >= _SUPPORTED_MS)

    def speed(self) -> float:
        """Of the fastest station, px/ms."""
        return float(np.hypot(self.g[:, 4], self.g[:, 5]).max())


def normal_part(cov: FloatArray, g: FloatArray) -> FloatArray:
    """(S,) variance along the left normal from (S, 3) covariances."""
    tx, ty = g[:, 2], g[:, 3]
    return np.asarray(ty * ty * cov[:, 0] - 2.0 * tx * ty * cov[:, 1] + tx * tx * cov[:, 2], dtype=np.float64)


def tangential_part(cov: FloatArray, g: FloatArray) -> FloatArray:
    """(S,) variance along the tangent from (S, 3) covariances."""
    tx, ty = g[:, 2], g[:, 3]
    return np.asarray(tx * tx * cov[:, 0] + 2.0 * tx * ty * cov[:, 1] + ty * ty * cov[:, 2], dtype=np.float64)
