"""One DLO: its state, its look, and one update."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from motiondlo.events.buckets import EventBuckets
from motiondlo.events.types import SensorGeometry
from motiondlo.frames.types import EndKind, FloatArray
from motiondlo.tracking.inextensible.arrays import Looks, numbers_of
from motiondlo.tracking.inextensible.confidence import Confidence
from motiondlo.tracking.inextensible.curve_filter import GAP_MS, CurveFilter
from motiondlo.tracking.inextensible.end_rows import EndPose
from motiondlo.tracking.inextensible.ends import EndTracker
from motiondlo.tracking.inextensible.filter_kernels import END_A, STRETCH
from motiondlo.tracking.inextensible.held_extent import HeldExtent, stands_clear
from motiondlo.tracking.inextensible.held_kernels import accumulate_presence
from motiondlo.tracking.inextensible.late import PastState, carried_innovation, oriented_like
from motiondlo.tracking.inextensible.params import InextensibleParams
from motiondlo.tracking.inextensible.profiles import log_ratios, prior_profiles, visible_at_start
from motiondlo.tracking.inextensible.rival_kernels import lay_out
from motiondlo.tracking.inextensible.rivals import no_rivals
from motiondlo.tracking.inextensible.row_kernels import find_end
from motiondlo.tracking.inextensible.shape import STRIDE
from motiondlo.tracking.inextensible.step_kernels import largest_innovation, place_end, publish_nodes
from motiondlo.tracking.inextensible.update_kernels import advance, look, remember
from motiondlo.tracking.types import Correction, TrackSource, TrackState


class InextensibleDlo(CurveFilter):
    """A curve that cannot stretch, tracked through event batches."""

    def __init__(self, correction: Correction, params: InextensibleParams, geometry: SensorGeometry) -> None:
        super().__init__(correction, params)
        p, m, s = params, self.m, self.s_px
        self.geometry = geometry
        self.id = correction.id
        self.t_corrected_us = correction.t_us
        self.reinitialised = 0
        length = self.layout.length_px
        self.diameter_px = correction.diameter_px if correction.diameter_px > 0 else p.diameter_px
        self.radius_px = 0.5 * self.diameter_px
        # what the stations see
        self.offset, self.sigma, self.age, self.quality, self.window, self.nis, self.accel, self.density = (
            np.zeros(m) for _ in range(8)
        )
        self.count = np.zeros(m, np.int64)
        self.good, self.covered, self.active = (np.zeros(m, np.uint8) for _ in range(3))
        self.window_max = np.full(m, p.window_max_ms)
        self.band = np.full(m, p.band_px)
        self.vn_past, self.past = np.zeros((4, m)), 0
        # look
        self.prior = prior_profiles(s, self.radius_px, correction.appearance, params)
        self.profile = self.prior.copy()
        self.floor = p.log_floor / self.prior.shape[2]
        self.llr = log_ratios(self.profile, self.floor)
        self.numbers = numbers_of(p, geometry.width_px, geometry.height_px, self.floor)
        # ends
        places = (correction.nodes[0].astype(np.float64), correction.nodes[-1].astype(np.float64))
        self.ends = [EndTracker(k, correction.ends[k], length * k, params, self.radius_px, places[k]) for k in range(2)]
        for end in self.ends:
            if end.kind is EndKind.HELD:
                clear = stands_clear(correction.appearance, end.index, length, self.radius_px)
                end.extent = HeldExtent(clear, params)
        self.end_velocity: list[tuple[float, float] | None] = [None, None]
        self.end_poses = [EndPose(self.n) for _ in range(2)]
        self._edge = np.zeros(2)
        # visibility
        inside_shape = (s >= -1.0) & (s <= length + 1.0)
        self.alive = (inside_shape & visible_at_start(s, self.radius_px, correction.appearance)).astype(np.float64)
        self.support = self.alive.copy()
        self.absent_ms = np.zeros(m)
        self.seen_ms = np.zeros(m)
        self.looks = Looks(
            self.offset, self.sigma, self.age, self.count, self.quality, self.window, self.window_max, self.density,
            self.band, self.accel, self.nis, self.active, self.good, self.covered, self.alive, self.support,
            self.absent_ms, self.seen_ms, self.vn_past, self.prior, self.profile, self.llr,
        )  # fmt: skip
        self.known_s_px = [0.0, length]
        self.end_seen_ms = [0.0, 0.0]
        self.seen, self.could = 0, 0
        # motion
        self.noise_factor = 1.0
        self.silent_ms = 0.0
        self.quiet_ms = 0.0
        self.loose_ms = 0.0
        self.unproved_px = 0.0
        self.background_per_ms = 0.0
        self.recent_speed = 0.0
        self.frozen = correction.velocity_px_s is None
        self.fit_px = 0.0
        self.stirred_since_shape = not self.frozen
        """Whether it has moved since the shape that was absorbed last."""
        self._turn = 0
        self._revisions: list[tuple[int, int, FloatArray]] = []
        self._state: TrackState | None = None
        self._confidence = Confidence()
        self.rivals = no_rivals()
        self.block = 0
        self.unexplained = 0.0
        """Share of the scene's events that lie near no DLO."""

    def _end_pose(self, end: EndTracker, dt_ms: float) -> EndPose:
        offset = float(self.x[2 * self.n + END_A + end.index]) if end.free else 0.0
        pose = self.end_poses[end.index]
        layout = self.layout
        pose.omega = float(place_end(
            end.s_px + offset, layout.s_lo_px, layout.ds_px, STRIDE, self.points, self.theta, self.jacobian,
            layout.basis, self.x, pose.place, pose.outward, pose.velocity, pose.jacobian, pose.angle_row,
        ))  # fmt: skip
        if end.index == 0:
            pose.outward *= -1.0
        before = self.end_velocity[end.index]
        vx, vy = before if before is not None else pose.velocity
        pose.acceleration = math.hypot(pose.velocity[0] - vx, pose.velocity[1] - vy) / dt_ms
        return pose

    def end_s_px(self, index: int) -> float:
        """Material coordinate up to which the DLO is believed to exist."""
        end = self.ends[index]
        sign = -1.0 if index == 0 else 1.0
        if end.kind is EndKind.TIP:
            return float(end.s_px + self.x[2 * self.n + END_A + index])
        reach = end.extent.beyond_px if end.kind is EndKind.HELD else 0.0
        if end.open:
            return float(self.known_s_px[index] + sign * self.params.station_px)
        return end.s_px + sign * reach

    # the step

    def step(self, buckets: EventBuckets, t_us: int, dt_ms: float) -> None:
        """Advance to ``t_us`` with everything on the surface."""
        p = self.params
        n = self.n
        self._turn += 1
        bridged_ms = self.bridge(dt_ms)
        lo_px, hi_px = self._extent()
        rows = self.rows
        rows.count, self.seen, self.could, speed, self.recent_speed = look(
            self.curve, self.places, self.looks, rows.arrays, self.numbers, n, buckets.rings, buckets.heads,
            buckets.columns, buckets.background, buckets.region, self.rivals, self.block, t_us, dt_ms, bridged_ms,
            self.recent_speed, self.noise_factor, lo_px, hi_px, self.past,
            # It moved on while nobody looked: silence then does not say that it stayed where it was.
            dt_ms > GAP_MS and not self.frozen,
        )  # fmt: skip
        first_end_row = rows.count
        poses = [self._end_pose(end, dt_ms) for end in self.ends]
        for end, pose in zip(self.ends, poses, strict=True):
            end.observe(buckets, t_us, dt_ms, pose, self.x, rows, self.geometry.width_px, self.geometry.height_px)
        learn = False
        end_nis = float(largest_innovation(self.cov, rows.h, rows.z, rows.w, first_end_row, rows.count))
        if self._idle(speed, dt_ms):
            self.x[:] = self.curve.kept_x
            self.x[n : 2 * n] *= 0.7
            self.cov[:] = self.curve.kept_cov
            self.silent_ms += dt_ms
            self.frozen = True
            self.locate()
        else:
            self.silent_ms = 0.0
            self.frozen = False
            self.stirred_since_shape = True
            self._confidence.advance(dt_ms, self.seen, self.could)
            fit = self.absorb(dt_ms, self.looks, self.numbers)
            if fit is not None:
                self._adapt(dt_ms, fit, end_nis)
                learn = self.seen > 4
                # Turn by turn: half the cost, and learning is slow anyway.
                end = self.ends[self._turn % 2]
                trusted = self.seen > 0.4 * max(self.could, 1)
                end.learn(buckets, t_us, self._end_pose(end, dt_ms), self.x, trusted)
        self.past = int(remember(
            self.curve, self.places, self.looks, self.numbers, buckets.rings, buckets.heads, buckets.columns,
            buckets.background, self.rivals, self.block, t_us, dt_ms, learn, self._turn, self.past,
        ))  # fmt: skip
        self.lay_out(t_us)
        for end in self.ends:
            if math.isfinite(end.tip_shift_px) or end.patch_events >= p.patch_events_min:
                self.end_seen_ms[end.index] += dt_ms
        if any(end.seen for end in self.ends):
            self.loose_ms = 0.0
        elif not self.frozen:
            self.loose_ms += dt_ms
        if any(math.isfinite(end.tip_shift_px) for end in self.ends):
            self.unproved_px = 0.0
        elif not self.frozen:
            self.unproved_px += speed * dt_ms
        self._follow_held_ends(buckets, t_us)
        self._follow_open_ends()
        for k, pose in enumerate(poses):
            self.end_velocity[k] = (float(pose.velocity[0]), float(pose.velocity[1]))
        self._state = None

    def lay_out(self, t_us: int) -> None:
        """Tell the other DLOs where this one is and how many events it makes."""
        if len(self.rivals.first) > 2:
            lay_out(
                self.rivals, self.rivals.first[self.block], t_us, self.p, self.th, self.kappa, self.vn, self.vt,
                self.omega, self.sn, self.density, self.active, not self.frozen,
                0.5 * STRIDE * self.layout.ds_px, self.profile,
            )  # fmt: skip

    def coast(self, dt_ms: float) -> None:
        """Advance by ``dt_ms`` without looking: what there is to see is not to be believed."""
        if self.frozen:
            return
        p = self.params
        share = max(p.noise_rest_share, min(self.recent_speed / p.noise_speed, 1.5))
        noise = p.noise_scale * share * self.noise_factor
        advance(self.curve, self.places, self.n, self.bridge(dt_ms), noise, p.velocity_decay_ms)
        self.seen = self.could = 0
        self._state = None

    def _extent(self) -> tuple[float, float]:
        """Material extent of the stations that are looked at."""
        extent = []
        for end, sign in zip(self.ends, (1.0, -1.0), strict=True):
            if end.open:
                extent.append(-sign * np.inf)
            elif end.held:
                # Beside the jaws their edges are nearer than the silhouettes.
                extent.append(end.s_px + sign * 0.5 * self.radius_px)
            else:
                extent.append(self.end_s_px(end.index) + sign * 0.25 * self.params.station_px)
        return extent[0], extent[1]

    def _follow_held_ends(self, buckets: EventBuckets, t_us: int) -> None:
        """Learn how far a held DLO is seen to go on into what holds it."""
        p = self.params
        for end in self.ends:
            if end.kind is not EndKind.HELD or self.frozen or self.seen < 0.4 * self.could:
                continue
            inward = 1 if end.index == 0 else -1
            extent = end.extent
            accumulate_presence(
                buckets.rings, buckets.heads, buckets.columns, buckets.last_us, t_us, end.s_px, inward,
                self.layout.s_lo_px, self.layout.ds_px, STRIDE, self.points, self.theta, self.vn, self.radius_px,
                self.profile, p.presence_window_ms, p.latency_ms, p.presence_velocity, p.presence_reach_px,
                p.presence_rate, extent.presence, extent.looks,
            )  # fmt: skip
            if self._turn % 8 == 0:
                extent.judge(end.jaws_px(self.end_poses[end.index], self.x))

    def _follow_open_ends(self) -> None:
        """Let a DLO that came from beyond the image grow as it comes in, and find its end."""
        p = self.params
        for end in self.ends:
            if not end.open or self.seen < 5:
                continue
            sign = 1.0 if end.index else -1.0
            sure = self.s_px[(self.good > 0) & (self.alive > 0.3)]
            if len(sure):
                outermost = float((sign * sure).max() * sign)
                if sign * (outermost - self.known_s_px[end.index]) > 0.0:
                    self.known_s_px[end.index] = outermost
            if find_end(
                int(sign), p.end_absent_ms, 12.0, self.geometry.width_px, self.geometry.height_px, self.p, self.s_px,
                self.good, self.absent_ms, self._edge,
            ):  # fmt: skip
                end.kind = EndKind.TIP
                end.found = True
                end.s_px = float(self._edge.mean())
                self.widen_end(end.index, p.end_found_sigma_px)

    def _idle(self, speed: float, dt_ms: float) -> bool:
        """Whether the DLO is to be frozen: what is in view of it makes no events."""
        p = self.params
        quiet = self.seen < p.idle_share * max(self.could, 1) and not any(end.moved for end in self.ends)
        self.quiet_ms = self.quiet_ms + dt_ms if quiet else 0.0
        # A fast DLO in view cannot be silent: after a few ms it has stopped, or events are missing.
        return quiet and (speed < 2.0 * p.idle_velocity or (self.could >= 4 and self.quiet_ms > p.stop_ms))

    def _adapt(self, dt_ms: float, fit: tuple[int, float, float], end_nis: float) -> None:
        p = self.params
        seen, median, self.fit_px = fit
        surprised = seen >= 3 and median > p.noise_surprise
        # What pulls a DLO along itself shows at its ends only.
        if surprised or end_nis > p.end_surprise:
            self.noise_factor = min(self.noise_factor * 2.0**dt_ms, p.noise_growth_max)
        else:
            self.noise_factor = max(1.0, self.noise_factor * 0.93**dt_ms)

    # rest and late corrections

    @property
    def asleep(self) -> bool:
        """Silent for so long that only fresh events nearby are worth a step."""
        return self.frozen and self.silent_ms >= self.params.asleep_after_ms

    @property
    def moving(self) -> bool:
        """Whether some part moves."""
        return self.state().moving

    def stirred(self, fresh: int, dt_ms: float) -> bool:
        """Whether ``fresh`` events nearby in ``dt_ms`` are more than the background that was seen at rest."""
        rate = fresh / dt_ms
        wakes = rate > 2.0 * self.background_per_ms + self.params.wake_events
        if self.frozen and not wakes:
            self.background_per_ms += 0.02 * (rate - self.background_per_ms)
        return wakes

    def past_state(self) -> PastState:
        """What a late correction for now will be compared with."""
        return PastState(
            self.p.copy(),
            self.sn.copy(),
            self.seen_ms.copy(),
            (self.end_seen_ms[0], self.end_seen_ms[1]),
            (self.end_s_px(0), self.end_s_px(1)),
        )

    def blend(self, correction: Correction, past: PastState, now_us: int) -> bool:
        """Absorb a late correction; False if it is too far from what was held at its time."""
        p = self.params
        n = self.n
        points = past.points + self._revised_since(correction.t_us)
        past = PastState(points, past.sigma_normal_px, past.seen_ms, past.end_seen_ms, past.ends_s_px)
        inside = (self.s_px >= past.ends_s_px[0] - 1.0) & (self.s_px <= past.ends_s_px[1] + 1.0)
        correction = oriented_like(correction, points[inside])
        tips = (self.ends[0].free, self.ends[1].free)
        carried = carried_innovation(
            correction, past, self.s_px, self.seen_ms, (self.end_seen_ms[0], self.end_seen_ms[1]), tips,
            p.correction_fade_ms, p.correction_bias_px,
        )  # fmt: skip
        if not carried.plausible:
            return False
        rows = self.rows
        rows.count = 0
        for i in np.flatnonzero(np.isfinite(carried.variance_px2)):
            row = np.zeros(self.size)
            row[:n] = self.h_normal[i]
            row[2 * n + STRETCH] = self.h_stretch[i]
            rows.add(row, float(carried.offset_px[i]), float(np.sqrt(carried.variance_px2[i])), robust=True)
        for end in self.ends:
            if np.isfinite(carried.end_variance_px2[end.index]):
                pose = self._end_pose(end, 1.0)
                row = np.zeros(self.size)
                row[:n] = pose.outward @ pose.jacobian
                row[2 * n + END_A + end.index] = -1.0 if end.index == 0 else 1.0
                sigma = float(np.sqrt(carried.end_variance_px2[end.index]))
                rows.add(row, carried.end_shift_px[end.index], sigma, robust=True)
        before = self.p.copy()
        if not self.absorb_correction(fresh=self.stirred_since_shape):
            return False
        self.stirred_since_shape = not self.frozen
        self._revisions.append((correction.t_us, now_us, self.p - before))
        del self._revisions[:-8]
        self.t_corrected_us = correction.t_us
        self._state = None
        return True

    def _revised_since(self, t_us: int) -> FloatArray:
        """(m, 2) what corrections absorbed after ``t_us`` for earlier times would have changed at ``t_us``."""
        shift = np.zeros((self.m, 2))
        for for_us, absorbed_us, change in self._revisions:
            if for_us <= t_us < absorbed_us:
                shift += change
        return shift

    # result

    def state(self) -> TrackState:
        """The estimate as nodes with covariance."""
        if self._state is None:
            self._state = self._make_state()
        elif self.frozen and abs(self._state.confidence - self.confidence()) > 0.01:
            self._state = replace(self._state, confidence=self.confidence())
        return self._state

    def _make_state(self) -> TrackState:
        p = self.params
        m = p.output_nodes
        nodes, velocity, cov, visible = np.empty((m, 2)), np.empty((m, 2)), np.empty((m, 3)), np.empty(m, np.uint8)
        fastest = publish_nodes(
            self.end_s_px(0), self.end_s_px(1), self.layout.s_lo_px, self.layout.ds_px, STRIDE, self.points, self.theta,
            self.jacobian, self.cov, self.x, self.support, p.visible_support,
            p.variance_share, p.bias_px,
            p.bias_end_px, p.bias_end_reach_px, self._tangent_bias_px(), self.geometry.width_px,
            self.geometry.height_px, nodes, velocity, cov, visible,
        )  # fmt: skip
        moving = bool(fastest > 100.0) and not self.frozen
        return TrackState(
            id=self.id,
            nodes=nodes,
            velocity_px_s=velocity,
            cov_px2=cov,
            visible=visible,
            diameter_px=self.diameter_px,
            confidence=self.confidence(),
            moving=moving,
            source=TrackSource.EVENT if self.seen else TrackSource.PREDICTED,
            t_corrected_us=self.t_corrected_us,
            fit_px=self.fit_px,
            reinitialised=self.reinitialised,
        )

    def _tangent_bias_px(self) -> float:
        """What all nodes may be off along the DLO: it grows while the DLO moves and neither end is seen.

        What is seen of the holder alone is as good as the height that it is taken to have: a share of the way.
        """
        p = self.params
        slips = (p.bias_tangent_px, p.slip_px_ms * self.loose_ms, p.slip_share * self.unproved_px)
        return min(math.hypot(*slips), 10.0 * p.bias_tangent_px)

    def confidence(self) -> float:
        """0..1: how likely the estimate is right."""
        spread = float(np.partition(self.sn, self.m // 2)[self.m // 2])
        return self._confidence.value(self.frozen, self.seen, spread, self.unexplained)
