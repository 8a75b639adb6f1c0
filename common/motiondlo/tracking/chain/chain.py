"""One DLO: its filter, its stations with their profiles, its ends; one step per event batch."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from motiondlo.events.types import SensorGeometry
from motiondlo.frames.types import EndKind
from motiondlo.geometry.curve import arc_length
from motiondlo.tracking.chain import filter_kernels, near_kernels, profile_kernels
from motiondlo.tracking.chain.ends import EXTRAS_PER_END, End, PatchScratch
from motiondlo.tracking.chain.params import ChainParams
from motiondlo.tracking.chain.spline import fit, weights
from motiondlo.tracking.chain.texture import PAD_PX, Texture, find_texture
from motiondlo.tracking.chain.texture_kernels import measure_texture
from motiondlo.tracking.chain.templates import profile_bins, profile_densities, seen_in_frame
from motiondlo.tracking.types import Correction, TrackSource, TrackState

FloatArray = npt.NDArray[np.float64]

_LINES = 3
_LINE_PX = 3.0
_RIM_PX = 4.0
_RESTING_PX_MS = 0.3
_LONGEST_STEP_MS = 5.0
_SLEEP_MS = 40.0
# Silence along the whole DLO after which even a fast one has stopped.
_STOP_MS = 4.0
_WATCH_US = 4000
_SHADOW_PX = 24.0
# A gripper's arm goes on behind it: this far, and so wide.
_ARM_PX = 300.0
_ARM_HALF_PX = 60.0


class Chain:
    """A tracked DLO."""

    def __init__(self, correction: Correction, params: ChainParams, geometry: SensorGeometry) -> None:
        self.id = correction.id
        self.params = params
        self.geometry = geometry
        self.diameter_px = max(correction.diameter_px, 4.0)
        self.radius_px = 0.5 * self.diameter_px
        self.ends_kind = correction.ends
        self._lay_out(correction)
        self._scratch = PatchScratch()
        self.support = np.where(self.inside & self._seen_at_start, 10.0, 0.0)
        self.boost = 1.0
        self.motion = 0.0
        self.still_ms = 1000.0
        self.texture_used = 0
        self.failures = 0
        self._updates = 0
        self._seen_share = 0.7
        self._x_before = self.x.copy()
        self._P_before = self.P.copy()
        self._silent_ms = 0.0
        self.asleep = False
        self.foreign = np.zeros(self.S, np.bool_)
        self._foreign_count = 0
        self._state: TrackState | None = None
        self.fit_px = 0.0
        self.observed = 0.0
        self.reinitialised = 0
        self.t_corrected_us = -1
        self.confidence = 1.0

    def touch(self) -> None:
        """The state was changed from outside an update: report it anew."""
        self._state = None
        filter_kernels.place(self.x, self.K, self.j0, self.w, self.w1, self.w2, self.g)

    @property
    def scratch_row(self) -> FloatArray:
        """(n,) scratch of the filter's updates."""
        return self._Ph

    @property
    def active_px(self) -> float:
        """Area of the sensor that the DLO's motion covers, px^2."""
        return float(self.use.sum()) * self.params.station_px * self.diameter_px if self.still_ms == 0.0 else 0.0

    # set-up

    def _lay_out(self, correction: Correction) -> None:
        p = self.params
        nodes = np.asarray(correction.nodes, dtype=np.float64)
        length = float(arc_length(nodes)[-1])
        self.length_px = length
        self.centre = np.array([self.geometry.width_px / 2.0, self.geometry.height_px / 2.0])
        before, after = (self._extension(kind) for kind in correction.ends)
        self._covered = [self._first_cover(nodes), self._first_cover(nodes[::-1])]
        line = self._extended(nodes, before, after)
        total = length + before + after
        spans = int(np.clip(round(total / p.knot_px), 4, p.max_nodes - 3))
        self.K = K = spans + 3
        self.span_px = total / spans
        self.stretch = self.span_px
        C = fit(line, total, K)
        n = 4 * K + 2 * EXTRAS_PER_END + 1
        self.x = np.zeros(n)
        self.x[:K], self.x[K : 2 * K] = C[:, 0], C[:, 1]
        self.u_first = before / self.span_px
        self.u_last = (before + length) / self.span_px
        self.u_end = float(spans)
        # Stations, on what was seen and on what it is continued by beyond the border (which may come into view).
        s0 = -before if correction.ends[0] is EndKind.BORDER else 0.0
        s1 = length + after if correction.ends[1] is EndKind.BORDER else length
        count = max(5, round((s1 - s0) / p.station_px) + 1)
        margin = min(8.0, 0.2 * (s1 - s0))
        self.station_s = np.linspace(s0 + margin, s1 - margin, count)
        self.station_u = (self.station_s + before) / self.span_px
        self.j0, self.w, self.w1, self.w2 = weights(self.station_u, K)
        S = self.S = count
        # Lengths are kept at the knots and half way between them.
        self.lj0, _, self.lw1, _ = weights(np.arange(0.0, spans + 0.25, 0.5), K)
        half = profile_bins(self.radius_px)
        self.anchor = np.ascontiguousarray(
            profile_densities(
                correction.appearance,
                np.clip(self.station_s, 0.0, length),
                self.radius_px,
                half,
                p.station_px,
            ),
            dtype=np.float32,
        )
        self._seen_at_start = (
            seen_in_frame(correction.appearance, self.station_s, self.radius_px, p.station_px)
            & (self.station_s > -8.0)
            & (self.station_s < length + 8.0)
        )
        self.density = self.anchor.copy()
        J = 2 * half + 1
        self.floor = 0.5 / J
        self.table = np.ascontiguousarray(np.log((self.anchor + self.floor) / (2 * self.floor)), dtype=np.float32)
        self.hist = np.zeros((S, 2, J + 4 * int(p.band_max_px) + 8), np.float32)
        self.g = np.zeros((S, 10))
        self.out = np.zeros((S, 8))
        self.nis = np.zeros(S)
        self.seen_ms = np.zeros(S)
        self.exists = np.ones(S, np.bool_)
        self.use = np.zeros(S, np.bool_)
        self.accel = np.zeros(S)
        self.cov_p = np.zeros((S, 3))
        self.cov_v = np.zeros((S, 3))
        self._vn_past = np.zeros((4, S))
        self._score = np.zeros((2, 4 * int(p.band_max_px) + 5), np.float32)
        self._ev_bin = np.zeros(profile_kernels.MAX_EVENTS, np.int64)
        self._ev_age = np.zeros(profile_kernels.MAX_EVENTS)
        self._ev_sign = np.zeros(profile_kernels.MAX_EVENTS, np.int64)
        self._Ph = np.zeros(n)
        self.own = np.zeros(K)
        filter_kernels.bends(self.x, K, self.own)
        self._bend_now = np.zeros(K)
        look = correction.appearance
        self.ends = tuple(
            End(correction.ends[k], k, look, length, self.radius_px, (self.u_first, self.u_last)[k]) for k in (0, 1)
        )
        self._place_output()
        self.texture = find_texture(look, length, self.radius_px, p.texture_patches)
        if self.texture is not None:
            self._texture_at = weights((self.texture.s_px + before) / self.span_px, K)
            self.texture_shifts = np.full(len(self.texture.s_px), np.nan)
        self._start_covariance(correction, before, length)
        filter_kernels.place(self.x, K, self.j0, self.w, self.w1, self.w2, self.g)
        self._look_inside()

    def _extension(self, kind: EndKind) -> float:
        """How far control nodes go on past an end."""
        if kind is EndKind.HELD:
            return self.params.held_cover_max_px
        return self.params.border_extension_px if kind is EndKind.BORDER else 0.0

    def _first_cover(self, nodes: FloatArray) -> float:
        """How far the DLO goes on, unseen, past the first of ``nodes`` if that is held.

        A gripper is higher than the DLO and so is shifted outwards in the image, over the DLO or away from it.
        """
        p = self.params
        inward = nodes[min(5, len(nodes) - 1)] - nodes[0]
        over = float((nodes[0] - self.centre) @ inward) / max(float(np.hypot(*inward)), 1e-9)
        return float(np.clip(p.held_cover * self.diameter_px + p.height_ratio * over, 0.0, p.held_cover_max_px))

    def _renew_covers(self) -> None:
        """A gripper that was measured tells by its shift against the frame how much of the DLO it covered there."""
        p = self.params
        changed = False
        for end in self.ends:
            if end.kind is not EndKind.HELD or not end.sure:
                continue
            e = 4 * self.K + EXTRAS_PER_END * end.which
            shift = float(self.x[e] / (1.0 + self.x[e + 2]))
            cover = float(np.clip(p.held_cover * self.diameter_px + shift, 0.0, p.held_cover_max_px))
            if abs(cover - self._covered[end.which]) > 1.5:
                self._covered[end.which] = cover
                changed = True
        if changed:
            self._place_output()

    def _extended(self, nodes: FloatArray, before: float, after: float) -> FloatArray:
        chord = max(2, round(len(nodes) * 30.0 / max(self.length_px, 1.0)))
        parts = [nodes]
        if before > 0.0:
            t = nodes[0] - nodes[min(chord, len(nodes) - 1)]
            parts.insert(0, nodes[0] + np.arange(before, 0.0, -5.0)[:, None] * t / np.hypot(*t))
        if after > 0.0:
            t = nodes[-1] - nodes[max(-chord - 1, -len(nodes))]
            steps = np.append(np.arange(5.0, after, 5.0), after)
            parts.append(nodes[-1] + steps[:, None] * t / np.hypot(*t))
        return np.concatenate(parts)

    def _start_covariance(self, correction: Correction, before: float, length: float) -> None:
        p, K = self.params, self.K
        n = len(self.x)
        s = (np.arange(K) - 1.0) * self.span_px
        gap = np.abs(s[:, None] - s[None, :])
        # Second-order Matern-like kernel along the arc, as the paper's geodesic kernel.
        r = np.sqrt(3.0) * gap / p.accel_length_px
        self.kernel = (1.0 + r) * np.exp(-r) + 1e-3 * np.eye(K)
        bias = np.exp(-0.5 * (gap / 150.0) ** 2)
        node_s = np.linspace(before, before + length, len(correction.sigma_normal_px))
        sigma = np.interp(s, node_s, correction.sigma_normal_px)
        P = np.zeros((n, n))
        position = 1.5 * bias + 0.3 * np.diag(sigma**2)
        velocity = self.kernel * 0.01
        for a in range(2):
            P[a * K : (a + 1) * K, a * K : (a + 1) * K] = position
            P[(2 + a) * K : (3 + a) * K, (2 + a) * K : (3 + a) * K] = velocity
        # The whole shape may be shifted along itself: where a frame sees an end is not where the next one sees it.
        slide = float(np.median(correction.sigma_tangent_px))
        along = np.gradient(np.stack([self.x[:K], self.x[K : 2 * K]], axis=1), axis=0)
        along /= np.maximum(np.hypot(along[:, 0], along[:, 1]), 1e-9)[:, None]
        mode = slide * along.T.reshape(-1)
        P[: 2 * K, : 2 * K] += np.outer(mode, mode)
        # What was never seen may turn and bend about the last place that was.
        for beyond in (np.maximum(before - s, 0.0), np.maximum(s - before - length, 0.0)):
            for mode in (0.06 * beyond, 0.0006 * beyond**2):
                for a in range(2):
                    P[a * K : (a + 1) * K, a * K : (a + 1) * K] += np.outer(mode, mode)
        for end in self.ends:
            e = 4 * K + EXTRAS_PER_END * end.which
            self.x[e : e + 3], variance = end.prior(p)
            P[e : e + 3, e : e + 3] = np.diag(variance)
        P[-1, -1] = p.scale_sigma**2
        self.P = P

    def _place_output(self) -> None:
        held = [end.kind is EndKind.HELD for end in self.ends]
        first = self.u_first - held[0] * self._covered[0] / self.span_px
        last = self.u_last + held[1] * self._covered[1] / self.span_px
        self.output_u = np.linspace(max(first, 0.0), min(last, self.u_end), self.params.output_nodes)
        self.oj0, self.ow, self.ow1, self.ow2 = weights(self.output_u, self.K)
        self.og = np.zeros((self.params.output_nodes, 10))
        self.oc = np.zeros((self.params.output_nodes, 3))

    def _look_inside(self) -> None:
        x, y = self.g[:, 0], self.g[:, 1]
        self.inside = (
            (x > _RIM_PX)
            & (y > _RIM_PX)
            & (x < self.geometry.width_px - 1 - _RIM_PX)
            & (y < self.geometry.height_px - 1 - _RIM_PX)
        )

    # one update

    @property
    def moves(self) -> bool:
        """Whether the DLO is known to move now."""
        return not self.asleep and self.still_ms == 0.0 and float(np.abs(self.g[:, 4:6]).max()) > _RESTING_PX_MS

    def mark(self, grid: npt.NDArray[np.uint32], bit: int) -> None:
        """Claim the tiles of the DLO, of its shadow and of what holds it."""
        near_kernels.mark(grid, self.g, self.radius_px + _SHADOW_PX, bit)
        for end in self.ends:
            if end.kind is EndKind.HELD:
                v = end.view(self.x, self.P, self.K)
                reach = np.arange(0.0, _ARM_PX, 24.0)
                near_kernels.mark(grid, v.point + reach[:, None] * v.outward, _ARM_HALF_PX, bit)

    def look_around(self, grid: npt.NDArray[np.uint32], bit: int) -> None:
        """Find the stations at which events may belong to another moving DLO."""
        self._foreign_count = near_kernels.marked_by_others(grid, self.g, bit, self.foreign)

    def _stays_asleep(self, last: npt.NDArray[np.int64], t_us: int) -> bool:
        watched = self.inside & self.exists & ~self.foreign
        events = profile_kernels.activity(last, t_us, t_us - _WATCH_US, self.g, self.radius_px + 6.0, watched)
        return events < self.params.wake_events

    def step(self, last: npt.NDArray[np.int64], t_us: int, dt_ms: float) -> None:
        """Advance by ``dt_ms`` to ``t_us`` with the events on the surface ``last`` (2, H, W)."""
        if self.asleep:
            if self._stays_asleep(last, t_us):
                return
            self.asleep = False
        self._state = None
        p, K, x, P = self.params, self.K, self.x, self.P
        g = self.g
        np.copyto(self._x_before, x)
        np.copyto(self._P_before, P)
        speed = float(np.hypot(g[:, 4], g[:, 5]).max())
        self._predict(dt_ms, speed)
        filter_kernels.place(x, K, self.j0, self.w, self.w1, self.w2, g)
        filter_kernels.place_covariance(P, K, self.j0, self.w, self.cov_p, False)
        filter_kernels.place_covariance(P, K, self.j0, self.w, self.cov_v, True)
        self._look_inside()
        sigma_n = np.sqrt(np.maximum(_normal_part(self.cov_p, g), 1e-6))
        sigma_v = np.sqrt(np.maximum(_normal_part(self.cov_v, g), 1e-6))
        band = np.clip(2.5 * sigma_n + p.band_px, p.band_px, p.band_max_px)
        vn = g[:, 6].copy()
        self.accel[:] = (vn - self._vn_past[0]) / (4.0 * dt_ms)
        active = self.inside & self.exists
        out = self.out
        profile_kernels.match_profiles(
            last, t_us, p.latency_us * 1e-3, g, sigma_v, self.accel, band, active, self.table, _LINES, _LINE_PX,
            p.window_px, p.window_min_ms, p.window_max_ms, p.window_accel_px, p.target_events, p.min_events, 0.4,
            self.hist, out, self._score, self._ev_bin, self._ev_age, self._ev_sign,
        )  # fmt: skip
        use = self.use
        use[:] = (out[:, 1] > 0.0) & (out[:, 2] > p.min_mean_llr)
        if self._foreign_count and speed < _RESTING_PX_MS:
            # Another DLO moves by: one at rest needs more than a few stations to be moved as well.
            use &= ~self.foreign
            if use.sum() < max(3, 0.2 * (active & ~self.foreign).sum()):
                use[:] = False
        reuse = np.maximum(1.0, out[:, 5] / dt_ms)
        doubt = np.where(out[:, 6] < 3.0, 4.0, 1.0)
        R = (p.sigma_floor_px**2 + 2.0 * out[:, 1] ** 2 * doubt + (0.2 * out[:, 4] ** 2) ** 2) * reuse
        self.nis[:] = 0.0
        before = g[:, :2].copy()
        filter_kernels.measure_normals(
            x,
            P,
            K,
            self.j0,
            self.w,
            g,
            out[:, 0].copy(),
            R,
            p.age_gain * out[:, 4],
            use,
            p.gate_sigma,
            self.nis,
            self._Ph,
        )
        self._adapt(dt_ms, use)
        filter_kernels.place(x, K, self.j0, self.w, self.w1, self.w2, g)
        moved = g[:, :2] - before
        shift = -moved[:, 0] * g[:, 3] + moved[:, 1] * g[:, 2]
        learn = use & (self.nis < 4.0) & (np.abs(g[:, 6]) > 0.3)
        profile_kernels.learn_profiles(
            self.hist,
            shift,
            learn,
            p.learn_rate * min(dt_ms, 2.0),
            self.density,
            self.anchor,
            p.learn_anchor,
            self.floor,
            self.table,
        )
        self._rest(dt_ms, speed)
        self._follow_into_view(last, t_us)
        for end in self.ends:
            end.measure(last, t_us, dt_ms, x, P, K, self.centre, p, self._Ph, self._scratch)
        if self.texture is not None:
            self._measure_texture(self.texture, last, t_us, dt_ms)
        self._renew_covers()
        filter_kernels.keep_length(x, P, K, self.lj0, self.lw1, self.stretch, p.length_sigma_px**2 / dt_ms, self._Ph)
        filter_kernels.keep_shape(x, P, K, self.own, p.bend_sigma_px**2 / dt_ms, self._Ph)
        filter_kernels.bends(x, K, self._bend_now)
        a = 1.0 - (1.0 - p.bend_memory) ** dt_ms
        self.own += a * (self._bend_now - self.own)
        filter_kernels.place(x, K, self.j0, self.w, self.w1, self.w2, g)
        self._vn_past[:-1] = self._vn_past[1:]
        self._vn_past[-1] = g[:, 6]
        self._judge(dt_ms)
        self._keep_sound()

    def _measure_texture(self, texture: Texture, last: npt.NDArray[np.int64], t_us: int, dt_ms: float) -> None:
        p, scratch = self.params, self._scratch
        j0, w, w1, w2 = self._texture_at
        self.texture_used = measure_texture(
            last, t_us, dt_ms, p.latency_us * 1e-3, p.window_px, p.window_max_ms, self.x, self.P, self.K, j0, w, w1, w2,
            texture.tables, PAD_PX, texture.half_length_px, texture.half_width_px, p.texture_sigma_px, self._Ph,
            scratch.a, scratch.d, scratch.p, scratch.age, scratch.score, scratch.out, self.texture_shifts,
        )  # fmt: skip

    def _follow_into_view(self, last: npt.NDArray[np.int64], t_us: int) -> None:
        """Where the DLO came in from beyond the image: what is supported exists, and at some place it ends."""
        p = self.params
        for k, end in enumerate(self.ends):
            if end.kind not in (EndKind.BORDER, EndKind.HIDDEN):
                continue
            step = 1 if k == 1 else -1
            edge = self.u_last if k == 1 else self.u_first
            ahead = np.flatnonzero((self.station_u - edge) * step > 0.0)[::step]
            for s in ahead:
                if not (self.inside[s] and self.use[s] and self.nis[s] < 9.0):
                    break
                edge = float(self.station_u[s])
            if edge != (self.u_last if k == 1 else self.u_first):
                self._set_edge(k, edge)
            if np.hypot(*self.g[-k, 4:6]) > 0.4 and end.look_for_tip(
                edge, last, t_us, self.x, self.P, self.K, p, self._scratch
            ):
                self._set_edge(k, end.u)
                self.exists &= (self.station_u - end.u) * step < 0.0

    def _set_edge(self, k: int, u: float) -> None:
        if k == 1:
            self.u_last = u
        else:
            self.u_first = u
        self._place_output()

    def _predict(self, dt_ms: float, speed: float) -> None:
        """Motion model; a gap in the batches is bridged in short steps, until all velocities have died away."""
        p = self.params
        least = p.accel_noise_rest if self.still_ms > 0.0 else p.accel_noise_onset
        q = p.accel_noise * max(least, min(speed / 5.0, 1.5)) * self.boost
        left = min(dt_ms, 3.0 * p.velocity_decay_ms)
        while left > 1e-9:
            step = min(left, _LONGEST_STEP_MS)
            decay = float(np.exp(-step / p.velocity_decay_ms))
            filter_kernels.predict(self.x, self.P, self.K, step, decay, self.kernel, q)
            filter_kernels.limit_velocity_variance(self.P, self.K, 9.0)
            left -= step
        self._relax_scale(dt_ms)

    def _keep_sound(self) -> None:
        """Numbers that fail (a covariance that is none any more) do not end the track: the last good state stays."""
        K, P = self.K, self.P
        self._updates += 1
        if self._updates % 64 == 0:
            np.add(P, P.T, out=self._P_before)
            np.multiply(self._P_before, 0.5, out=P)
        diagonal = np.diagonal(P)
        if np.isfinite(self.x).all() and np.isfinite(diagonal).all() and float(diagonal.min()) >= 0.0:
            return
        self.failures += 1
        np.copyto(self.x, self._x_before)
        np.copyto(P, self._P_before)
        self.x[2 * K : 4 * K] = 0.0
        P[np.arange(2 * K), np.arange(2 * K)] += 4.0
        self.boost = 1.0
        filter_kernels.place(self.x, K, self.j0, self.w, self.w1, self.w2, self.g)

    def _judge(self, dt_ms: float) -> None:
        """Confidence: how much of what should be seen is seen, how sure the place along the DLO is, how surprised."""
        out, g = self.out, self.g
        expected = self.inside & self.exists & (self.support > 0.0)
        expected &= (out[:, 3] >= self.params.min_events) | (np.abs(g[:, 6]) > 0.7)
        a = 1.0 - float(np.exp(-dt_ms / 8.0))
        if expected.sum() >= 3:
            self._seen_share += a * (float((self.use & expected).sum()) / float(expected.sum()) - self._seen_share)
        elif self.still_ms == 0.0:
            self._seen_share += 0.3 * a * (0.0 - self._seen_share)
        along = _tangential_part(self.cov_p, g)[self.inside & self.exists]
        sigma_t = float(np.sqrt(max(float(np.median(along)), 0.0))) if len(along) else 50.0
        unmatched = max(end.unmatched_ms for end in self.ends)
        in_view = float((self.inside & self.exists).sum()) / max(float(self.exists.sum()), 1.0)
        self.confidence = float(
            np.clip(self._seen_share / 0.7, 0.0, 1.0)
            / (1.0 + (sigma_t / 30.0) ** 2)
            / (1.0 + unmatched / 10.0)
            / (1.0 + 0.05 * (self.boost - 1.0))
            * min(1.0, float(np.sqrt(in_view / 0.25)))
        )

    def _relax_scale(self, dt_ms: float) -> None:
        """The common scale wanders about zero: perspective and height change it by about a percent, never by more."""
        p = self.params
        keep = float(np.exp(-dt_ms / p.scale_memory_ms))
        self.x[-1] *= keep
        self.P[-1, :] *= keep
        self.P[:, -1] *= keep
        self.P[-1, -1] += p.scale_sigma**2 * (1.0 - keep * keep)

    def _adapt(self, dt_ms: float, use: npt.NDArray[np.bool_]) -> None:
        seen = self.nis[self.nis > 0.0]
        surprised = max(end.surprise for end in self.ends) > 4.0
        if len(seen) >= 3 or surprised:
            if surprised or float(np.median(seen)) > 1.5:
                self.boost = min(self.boost * 2.0**dt_ms, 30.0)
            else:
                self.boost = max(1.0, self.boost * 0.93**dt_ms)
        self.fit_px = float(np.sqrt(np.mean(self.out[use, 0] ** 2))) if use.any() else 0.0

    def _rest(self, dt_ms: float, speed: float) -> None:
        p, out, g = self.params, self.out, self.g
        found = out[:, 3]
        vn = np.abs(g[:, 6])
        self.support[~self.inside] = 0.0
        self.seen_ms[self.use] += dt_ms
        self.support[self.use] = np.minimum(self.support[self.use] + dt_ms, 10.0)
        vanished = (found >= 0) & (found < p.min_events) & (vn > 0.7)
        self.support[vanished] = np.maximum(self.support[vanished] - dt_ms, 0.0)
        silent = self.inside & (found >= 0) & (found < p.min_events) & (vn < 0.5) & (self.support >= 5.0)
        filter_kernels.rest_normals(
            self.x, self.P, self.K, self.j0, self.w, g, silent, 0.15**2 / dt_ms, False, self._Ph
        )
        looked = self.inside & (found >= 0) & ~self.foreign
        quiet = looked & (found < p.min_events)
        silent_all = self.use.sum() <= 1 and looked.sum() >= 4 and quiet.sum() > 0.8 * looked.sum()
        self._silent_ms = self._silent_ms + dt_ms if silent_all else 0.0
        stopped = silent_all and speed >= 1.0 and self._silent_ms >= _STOP_MS
        if stopped:
            # It stopped where its last events were.
            K = self.K
            self.x[: 2 * K] -= self.x[2 * K : 4 * K] * self._silent_ms
            self.x[2 * K : 4 * K] = 0.0
        if silent_all and (speed < 1.0 or stopped):
            everywhere = np.ones(self.S, np.bool_)
            filter_kernels.rest_normals(
                self.x, self.P, self.K, self.j0, self.w, g, everywhere, 0.1**2 / dt_ms, True, self._Ph
            )
            self.still_ms += dt_ms
            self.asleep = self.still_ms >= _SLEEP_MS
        else:
            self.still_ms = 0.0

    # report

    def state(self) -> TrackState:
        """The DLO as it is reported."""
        if self._state is not None:
            return self._state
        K = self.K
        filter_kernels.place(self.x, K, self.oj0, self.ow, self.ow1, self.ow2, self.og)
        filter_kernels.place_covariance(self.P, K, self.oj0, self.ow, self.oc, False)
        nodes = self.og[:, :2].copy()
        cov = self.oc.copy()
        floor = (self.params.bias_sigma * self.diameter_px) ** 2
        cov[:, 0] += floor
        cov[:, 2] += floor
        seen = np.interp(self.output_u, self.station_u, np.where(self.inside, self.support, 0.0)) >= 5.0
        inside = (
            (nodes[:, 0] >= 0)
            & (nodes[:, 1] >= 0)
            & (nodes[:, 0] <= self.geometry.width_px - 1)
            & (nodes[:, 1] <= self.geometry.height_px - 1)
        )
        moving = self.still_ms == 0.0
        source = TrackSource.EVENT if self.use.any() or not moving else TrackSource.PREDICTED
        self._state = TrackState(
            id=self.id,
            nodes=nodes,
            velocity_px_s=self.og[:, 4:6] * 1e3,
            cov_px2=cov,
            visible=(seen & inside).astype(np.uint8),
            diameter_px=self.diameter_px,
            confidence=self.confidence,
            moving=moving,
            source=source,
            t_corrected_us=self.t_corrected_us,
            fit_px=self.fit_px,
            reinitialised=self.reinitialised,
        )
        return self._state


def _normal_part(cov: FloatArray, g: FloatArray) -> FloatArray:
    """(S,) variance along the left normal from (S, 3) covariances."""
    tx, ty = g[:, 2], g[:, 3]
    return np.asarray(ty * ty * cov[:, 0] - 2.0 * tx * ty * cov[:, 1] + tx * tx * cov[:, 2], dtype=np.float64)


def _tangential_part(cov: FloatArray, g: FloatArray) -> FloatArray:
    """(S,) variance along the tangent from (S, 3) covariances."""
    tx, ty = g[:, 2], g[:, 3]
    return np.asarray(tx * tx * cov[:, 0] + 2.0 * tx * ty * cov[:, 1] + ty * ty * cov[:, 2], dtype=np.float64)
