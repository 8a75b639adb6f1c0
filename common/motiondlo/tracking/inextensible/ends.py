"""What is measured at either end of a DLO: the patch of what holds it, or its free tip."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt
from numpy.lib.stride_tricks import sliding_window_view

from motiondlo.events.buckets import EventBuckets
from motiondlo.frames.types import EndKind, FloatArray
from motiondlo.tracking.inextensible.end_kernels import (
    collect_patch,
    collect_tip,
    learn_patch,
    match_patch,
    match_tip,
)
from motiondlo.tracking.inextensible.end_rows import EndPose, Rows
from motiondlo.tracking.inextensible.filter_kernels import CONSTANTS, END_A, RATIO_A
from motiondlo.tracking.inextensible.held_extent import HeldExtent
from motiondlo.tracking.inextensible.observe_kernels import BACKGROUND_SIGMAS
from motiondlo.tracking.inextensible.params import InextensibleParams
from motiondlo.tracking.inextensible.rivals import no_rivals

_PATCH_CAPACITY = 8000
_SURE_LOOKS = 6
"""Of a patch, from which on it is matched with what was learned."""
_PATCH_FAR = 3
"""How many times further a patch is searched that is not found near by."""
_TIP_REACH_PX = 40
_TIP_EDGE_PX = 0.5
"""Where the events of the silhouettes end, beyond a tip."""
_TIP_WIDTH_PX = 0.7
_TIP_FLOORS = (0.03, 0.2, 0.5)
"""Events of other things beyond a tip, over those of a pixel of its silhouettes."""
_TIP_FACES = (0.0, 1.0, 3.0, 8.0, 20.0)
"""Events of a tip's own face, over those of a pixel of its silhouettes: many when it moves along itself."""
_TIP_SEARCH_PX = 14
_TIP_SEARCH_FAR_PX = 34
CONCENTRATED = 3.0
"""How much denser the events of a tip are where they are than on the mean over all its surroundings."""


def tip_tables() -> tuple[FloatArray, FloatArray]:
    """Events expected along the tangent over a tip, a pixel a column, the tip in the middle (see match_tip)."""
    reach = _TIP_REACH_PX + _TIP_SEARCH_FAR_PX
    at = np.arange(-reach, reach + 1, dtype=np.float64)
    sides = 1.0 / (1.0 + np.exp((at - _TIP_EDGE_PX) / (0.55 * _TIP_WIDTH_PX)))
    face = np.exp(-0.5 * (at / _TIP_WIDTH_PX) ** 2)
    levels = np.stack([sides + share * face + floor for share in _TIP_FACES for floor in _TIP_FLOORS])
    sums = sliding_window_view(levels, 2 * _TIP_REACH_PX + 1, axis=1).sum(axis=2)[:, ::-1]
    return np.log(levels), np.ascontiguousarray(np.log(sums))


def own_events(count: int, beside: float) -> int:
    """How many of ``count`` events are surely more than the ``beside`` that lie there in any case."""
    return count if beside <= 0.0 else max(int(count - beside - BACKGROUND_SIGMAS * math.sqrt(beside)), 0)


@dataclass
class EndTracker:
    """One end. ``index`` 0 is the first node's, 1 the last node's; ``s_px`` its material coordinate."""

    index: int
    kind: EndKind
    s_px: float
    params: InextensibleParams
    radius_px: float
    reference: FloatArray
    """(2,) place of the end when the track started."""
    template: npt.NDArray[np.float32] = field(init=False)
    log_template: npt.NDArray[np.float32] = field(init=False)
    found: bool = False
    """The tip came into view after the start."""
    learned: int = 0
    tip_seen: int = 0
    patch_events: int = 0
    tip_rate: float = 0.0
    """Events of the tip per ms, lately."""
    background: float = -1.0
    """Events per ms in the patch at rest; -1 before the first look."""
    stirred: bool = False
    """The patch has clearly more events than at rest."""
    quiet_ms: float = 0.0
    shift_px: float = 0.0
    tip_shift_px: float = float("nan")

    def __post_init__(self) -> None:
        p = self.params
        rows = int(p.patch_length_px + p.patch_inward_px) + 1
        columns = int(2 * p.patch_half_width_px) + 1
        self.template = np.full((rows, columns), 1.0 / (rows * columns), np.float32)
        self.log_template = np.zeros((rows, columns), np.float32)
        self._tip_logs, self._tip_norms = tip_tables()
        self.extent = HeldExtent(False, p)
        self._histogram = np.zeros(2 * _TIP_REACH_PX + 1)
        self._a = np.empty(_PATCH_CAPACITY, np.float32)
        self._b = np.empty(_PATCH_CAPACITY, np.float32)
        self._age = np.empty(_PATCH_CAPACITY, np.float32)
        self._match = np.zeros(7)
        self._tip = np.zeros(2)
        self._own_events = 0
        self._window_ms = 1.0
        self._used_ms = p.window_max_ms
        self._tip_moves = False
        self._tip_missed = False
        self.rivals = no_rivals()
        self.block = 0

    @property
    def held(self) -> bool:
        """Whether something rigid may hold this end."""
        return self.kind in (EndKind.HELD, EndKind.UNKNOWN)

    @property
    def open(self) -> bool:
        """Whether the DLO goes on beyond this end, nobody knows how far."""
        return self.kind is EndKind.BORDER

    @property
    def moved(self) -> bool:
        """Whether this end was seen to move by the last look."""
        if math.isfinite(self.tip_shift_px):
            return self._tip_moves
        enough = self.held and self.stirred and self.patch_events >= self.params.patch_events_min
        return enough and (self.shift_px > 1.0 or self.learned < 2)

    @property
    def seen(self) -> bool:
        """Whether the last look measured this end along the DLO."""
        return math.isfinite(self.tip_shift_px) or self.quiet_ms > 0.0 or (self.learned > 2 and self.patch_events > 0)

    @property
    def free(self) -> bool:
        """Whether this end is a tip that can be measured."""
        return self.kind is EndKind.TIP

    def jaws_px(self, pose: EndPose, x: FloatArray) -> float:
        """How far what holds the end has moved outward of it by its height, since the track started."""
        lever = pose.place - self.reference
        return float(x[len(x) - CONSTANTS + RATIO_A + self.index]) * float(lever @ pose.outward)

    def observe(
        self,
        buckets: EventBuckets,
        t_us: int,
        dt_ms: float,
        pose: EndPose,
        x: FloatArray,
        rows: Rows,
        width: int,
        height: int,
    ) -> None:
        """Append the rows that this end gives now."""
        self.tip_shift_px = float("nan")
        self.shift_px = 0.0
        if self.held:
            self._observe_patch(buckets, t_us, dt_ms, pose, x, rows, width, height)
        elif self.free:
            self._observe_tip(buckets, t_us, dt_ms, pose, x, rows, width, height)

    def learn(self, buckets: EventBuckets, t_us: int, pose: EndPose, x: FloatArray, trusted: bool) -> None:
        """Learn the patch or the tip's profile at the corrected pose."""
        p = self.params
        speed = math.hypot(pose.velocity[0], pose.velocity[1])
        # The first look counts most: what holds the DLO starts from rest, where the pose is known best.
        sure = trusted or (self.learned < _SURE_LOOKS and self.stirred)
        if self.held and self.patch_events >= p.patch_events_min and sure and abs(self.shift_px) < 2.5:
            count, _ = self._collect(buckets, t_us, pose, x)
            if self.learned >= _SURE_LOOKS:
                self._align(count)
            rate = max(p.patch_learn_rate if speed > 0.5 else 0.3 * p.patch_learn_rate, 1.0 / (self.learned + 1))
            learn_patch(
                self.template, self.log_template, self._a, self._b, count,
                -p.patch_inward_px, p.patch_half_width_px, rate, 0.3,
            )  # fmt: skip
            self.learned += 1

    def _match_patch(self, count: int, reach_px: int) -> None:
        p = self.params
        match_patch(
            self.log_template, self._a, self._b, count, -p.patch_inward_px, p.patch_half_width_px, reach_px,
            p.patch_events_used, self._match,
        )  # fmt: skip

    def _align(self, count: int) -> None:
        """Move the events of the patch to where its template is matched: a slip of the state is not to be learned."""
        self._match_patch(count, self.params.patch_reach_px)
        out, across, turn = (float(value) for value in self._match[:3])
        c, s = math.cos(turn), math.sin(turn)
        a, b = self._a[:count], self._b[:count]
        a[:], b[:] = c * a + s * b - out, -s * a + c * b - across

    def _follow_background(self, rate: float, speed: float, dt_ms: float) -> None:
        """What passes under or beside a gripper at rest (a belt, flicker) is not the gripper's motion."""
        if self.background < 0.0:
            self.background = rate
        self.stirred = rate > 2.0 * self.background + 0.125 * self.params.patch_events_min
        if self.learned == 0 and speed < 0.1 and not self.stirred:
            self.background += 0.05 * dt_ms * (rate - self.background)

    def _window(self, pose: EndPose) -> float:
        p = self.params
        speed = math.hypot(pose.velocity[0], pose.velocity[1])
        longest = math.sqrt(p.window_acceleration_px / max(pose.acceleration, 1e-3))
        longest = min(max(longest, 1.5), p.window_max_ms)
        return min(max(4.0 / max(speed, 1e-3), p.window_min_ms), longest)

    def _collect(self, buckets: EventBuckets, t_us: int, pose: EndPose, x: FloatArray) -> tuple[int, float]:
        p = self.params
        ratio = float(x[len(x) - CONSTANTS + RATIO_A + self.index])
        lever_x, lever_y = pose.place[0] - self.reference[0], pose.place[1] - self.reference[1]
        # What lies there in any case neither counts nor ends the window.
        area_px2 = 2.0 * p.patch_half_width_px * (p.patch_length_px + p.patch_inward_px)
        beside_per_ms = area_px2 * buckets.background_at(float(pose.place[0]), float(pose.place[1]))
        target = p.patch_events_used + int(beside_per_ms * self._window_ms)
        count, age, window = collect_patch(
            buckets.rings, buckets.heads, buckets.columns, t_us, pose.place[0] + ratio * lever_x,
            pose.place[1] + ratio * lever_y, pose.outward[0], pose.outward[1], pose.velocity[0] * (1.0 + ratio),
            pose.velocity[1] * (1.0 + ratio), pose.omega, p.window_min_ms, self._window_ms,
            1.25 * self._used_ms + 0.25, target, p.latency_ms, -p.patch_inward_px, p.patch_length_px,
            p.patch_half_width_px, 1.4 * self.radius_px, self._a, self._b, self._age,
        )  # fmt: skip
        self._window_ms = self._used_ms = float(window)
        self._own_events = own_events(int(count), beside_per_ms * self._window_ms)
        return int(count), float(age)

    def _observe_patch(
        self,
        buckets: EventBuckets,
        t_us: int,
        dt_ms: float,
        pose: EndPose,
        x: FloatArray,
        rows: Rows,
        width: int,
        height: int,
    ) -> None:
        p = self.params
        place_x, place_y = pose.place.tolist()
        out_x, out_y = pose.outward.tolist()
        self._window_ms = self._window(pose)
        inside = -20.0 < place_x < width + 20.0 and -20.0 < place_y < height + 20.0
        self.patch_events = 0
        if not inside:
            self.quiet_ms = 0.0
            return
        count, age = self._collect(buckets, t_us, pose, x)
        own = self.patch_events = self._own_events
        v_x, v_y = pose.velocity.tolist()
        self._follow_background(own / self._window_ms, math.hypot(v_x, v_y), dt_ms)
        axes = ((out_x, out_y), (-out_y, out_x))
        ratio = float(x[len(x) - CONSTANTS + RATIO_A + self.index])
        middle = 0.4 * p.patch_length_px
        seen = 0.0 < place_x + middle * out_x < width and 0.0 < place_y + middle * out_y < height
        if own < p.patch_events_min:
            self.quiet_ms = self.quiet_ms + dt_ms if own < p.patch_events_min // 2 and seen else 0.0
            if self.learned >= 3 and self.quiet_ms > 1.5:
                for axis in axes:
                    speed = axis[0] * v_x + axis[1] * v_y
                    rows.add_end(pose, axis, 0.0, (0.0, 1.0), -speed, p.patch_rest_sigma / math.sqrt(dt_ms))
                rows.add_end(pose, (0.0, 0.0), 1.0, (0.0, 1.0), -pose.omega, 0.01 / math.sqrt(dt_ms))
            return
        self.quiet_ms = 0.0
        if self.learned < 2:
            return
        self._match_patch(count, p.patch_reach_px)
        if math.hypot(self._match[0], self._match[1]) >= p.patch_reach_px:
            # It set off faster than was predicted.
            self._match_patch(count, _PATCH_FAR * p.patch_reach_px)
        used = min(count, p.patch_events_used)
        self.shift_px = math.hypot(self._match[0], self._match[1])
        if self.shift_px >= _PATCH_FAR * p.patch_reach_px or self._match[3] < 0.1:
            return
        reuse = math.sqrt(max(1.0, self._window_ms / dt_ms))
        lag = -age * p.age_share
        lever_x, lever_y = place_x - float(self.reference[0]), place_y - float(self.reference[1])
        for k, axis in enumerate(axes):
            curvature = float(self._match[4 + k]) * used
            if curvature < 0.02:
                continue
            sigma = math.hypot(p.patch_sigma_px, 2.0 / math.sqrt(curvature)) * reuse
            constant = (RATIO_A + self.index, axis[0] * lever_x + axis[1] * lever_y)
            shares = (1.0 + ratio, lag * (1.0 + ratio))
            rows.add_end(pose, axis, 0.0, shares, float(self._match[k]), sigma, constant)
            if k == 0:
                # Where its template lies outward of the end is known no better than when it was first seen.
                rows.h[rows.count - 1, len(x) - CONSTANTS + END_A + self.index] = 1.0
        if self._match[6] * used > 100.0:
            sigma = p.patch_angle_sigma_rad * reuse
            rows.add_end(pose, (0.0, 0.0), 1.0, (1.0, lag), float(self._match[2]), sigma)

    def _tip_histogram(self, buckets: EventBuckets, t_us: int, pose: EndPose) -> tuple[int, float]:
        area_px2 = 2.0 * (self.radius_px + 2.0) * len(self._histogram)
        count, age = collect_tip(
            buckets.rings, buckets.heads, buckets.columns, t_us, pose.place[0], pose.place[1], pose.outward[0],
            pose.outward[1], pose.velocity[0], pose.velocity[1], self._window_ms, self.params.latency_ms,
            self.radius_px + 2.0, self.rivals, self.block, CONCENTRATED * self.tip_rate / area_px2, self._histogram,
        )  # fmt: skip
        beside = 2.0 * (self.radius_px + 2.0) * self._window_ms
        beside *= buckets.background_at(float(pose.place[0]), float(pose.place[1]))
        if beside > 0.0:
            np.maximum(self._histogram - beside, 0.0, out=self._histogram)
        return own_events(int(count), beside * len(self._histogram)), float(age)

    def _observe_tip(
        self,
        buckets: EventBuckets,
        t_us: int,
        dt_ms: float,
        pose: EndPose,
        x: FloatArray,
        rows: Rows,
        width: int,
        height: int,
    ) -> None:
        p = self.params
        margin = 12.0
        if not (margin < pose.place[0] < width - margin and margin < pose.place[1] < height - margin):
            return
        self._window_ms = max(p.window_min_ms, min(self._window(pose), p.tip_events_target / max(self.tip_rate, 1.0)))
        count, age = self._tip_histogram(buckets, t_us, pose)
        self.tip_rate = count / self._window_ms
        if count < p.tip_events_min:
            return
        # A tip that was just found lies anywhere between two stations, one that was missed has gone further.
        far = self.found if self.tip_seen < 5 else self._tip_missed
        reach_px = _TIP_SEARCH_FAR_PX if far else _TIP_SEARCH_PX
        match_tip(self._histogram, self._tip_logs, self._tip_norms, reach_px, self._tip)
        self._tip_missed = self._tip[1] <= 0.0
        if self._tip_missed:
            return
        self.tip_shift_px = float(self._tip[0])
        self.tip_seen += 1
        # From rest a tip goes a few pixels at most between two looks; a sudden jump is something else that passes.
        gone_px = abs(self.tip_shift_px)
        self._tip_moves = gone_px > 1.0 and (gone_px < 4.0 or self._tip_moves)
        reuse = max(1.0, self._window_ms / dt_ms)
        sigma = math.sqrt((p.tip_sigma_px**2 + 4.0 * float(self._tip[1]) ** 2 + (p.sigma_age * age**2) ** 2) * reuse)
        axis = (float(pose.outward[0]), float(pose.outward[1]))
        constant = (END_A + self.index, -1.0 if self.index == 0 else 1.0)
        rows.add_end(pose, axis, 0.0, (1.0, -age * p.age_share), self.tip_shift_px, sigma, constant, robust=True)
