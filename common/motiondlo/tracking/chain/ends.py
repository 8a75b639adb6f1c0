"""The ends of a chain as rigid patches: what holds it (a gripper, higher than the cable) or its free tip.

The tangential direction is measured nowhere else: edges along the cable show only motion along their normals.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from motiondlo.frames.types import Appearance, EndKind
from motiondlo.tracking.chain import filter_kernels, patch_kernels
from motiondlo.tracking.chain.params import ChainParams
from motiondlo.tracking.chain.spline import weights
from motiondlo.tracking.chain.templates import EndPatch, end_patch

FloatArray = npt.NDArray[np.float64]
F4 = npt.NDArray[np.float32]

EXTRAS_PER_END = 3
"""Filter states of an end: offset of the patch along the outward tangent and the left normal (px), height ratio."""

_PAD = 24
_DIRECTIONS = 16
_STEP_HALF = 30
_HIDDEN_TRAVEL_PX = 60.0
_QUIET_MS = 5.0
_PATCH_GATE = 60.0
_DOUBT_MS = 4.0
"""Without a match for so long a patch is looked for widely again."""
_REST_MS = 20.0
"""Rest that counts as one more look at where it is."""
_SURE_MATCHES = 5


@dataclass
class PatchScratch:
    """Buffers that all ends of all chains share."""

    a: FloatArray = field(default_factory=lambda: np.zeros(patch_kernels.MAX_EVENTS))
    d: FloatArray = field(default_factory=lambda: np.zeros(patch_kernels.MAX_EVENTS))
    p: npt.NDArray[np.int64] = field(default_factory=lambda: np.zeros(patch_kernels.MAX_EVENTS, np.int64))
    age: FloatArray = field(default_factory=lambda: np.zeros(patch_kernels.MAX_EVENTS))
    score: F4 = field(default_factory=lambda: np.zeros((2 * _PAD + 1, 2 * _PAD + 1), dtype=np.float32))
    second: F4 = field(default_factory=lambda: np.zeros((2 * _PAD + 1, 2 * _PAD + 1), dtype=np.float32))
    counts: FloatArray = field(default_factory=lambda: np.zeros(2 * _STEP_HALF + 1))
    out: FloatArray = field(default_factory=lambda: np.zeros(7))


@dataclass
class EndView:
    """An end in the current state: everything that its measurement needs."""

    point: FloatArray
    outward: FloatArray
    normal: FloatArray
    velocity: FloatArray
    stretch: float
    nodes: npt.NDArray[np.int64]
    """(4,) control nodes."""
    w: FloatArray
    w1: FloatArray
    rotation: float
    """rad/ms."""
    sigma_v: float
    """px/ms."""


class End:
    """One end of a chain; measures the shift of its patch, or of the place where events end, against the prediction."""

    def __init__(
        self, kind: EndKind, which: int, look: Appearance | None, length_px: float, radius_px: float, u: float
    ) -> None:
        self.kind = kind
        self.which = which
        self.u = u
        """Material coordinate at which the segmented shape ended: the patch's origin."""
        self.sign = -1.0 if which == 0 else 1.0
        self.radius_px = radius_px
        self.patch: EndPatch | None = None
        self.acquired = 0
        """Matches absorbed so far."""
        self.measured = False
        self.surprise = 0.0
        """Largest normalised innovation squared of the last update."""
        self.seen_ms = 0.0
        self.unmatched_ms = 0.0
        """How long the patch has made events that fit it nowhere."""
        self.events = 0
        self.step_px: float | None = None
        """For a tip without a patch: where its events end, relative to ``u``."""
        self._votes: list[tuple[float, FloatArray]] = []
        self._resting_at: tuple[FloatArray, FloatArray] | None = None
        """Place and tangent at which a silent patch came to rest."""
        self._resting_variance = 1.0
        if look is not None:
            if kind is EndKind.HELD:
                self.patch = end_patch(look, which, length_px, 6.0, 78.0, 46.0)
            elif kind in (EndKind.TIP, EndKind.UNKNOWN):
                self.patch = end_patch(look, which, length_px, -26.0, 20.0, radius_px + 8.0, radius_px)
        if self.patch is not None and self.patch.strength < 0.01:
            self.patch = None
        if self.patch is not None:
            self._prepare(self.patch)

    def _prepare(self, patch: EndPatch) -> None:
        rows, columns = patch.grad_a.shape
        self._tables = np.zeros((_DIRECTIONS, 2, rows + 2 * _PAD, columns + 2 * _PAD), np.float32)
        density = np.zeros((2, rows, columns), np.float32)
        for k in range(_DIRECTIONS):
            angle = 2.0 * np.pi * k / _DIRECTIONS
            patch_kernels.build_table(
                patch.grad_a, patch.grad_d, float(np.cos(angle)), float(np.sin(angle)), _PAD, density, self._tables[k]
            )
        magnitude = np.hypot(patch.grad_a, patch.grad_d)
        scale = np.where(magnitude > 0.03, 1.0 / np.sqrt(np.maximum(magnitude, 1e-6)), 0.0)
        self._lean_a = np.pad(patch.grad_a * scale, _PAD).astype(np.float32)
        self._lean_d = np.pad(patch.grad_d * scale, _PAD).astype(np.float32)
        self._box = np.array([patch.a0, patch.a1, patch.dm])

    @property
    def sure(self) -> bool:
        """Whether the patch was matched often enough to trust where it is."""
        return self.acquired >= _SURE_MATCHES

    def prior(self, params: ChainParams) -> tuple[FloatArray, FloatArray]:
        """Means and variances of the end's extras."""
        if self.kind is EndKind.HELD:
            var = params.patch_offset_sigma_px**2
            return np.array([0.0, 0.0, params.height_ratio]), np.array([var, var, params.height_ratio_sigma**2])
        return np.zeros(3), np.array([0.25, 0.25, 1e-10])

    def view(self, x: FloatArray, P: FloatArray, K: int) -> EndView:
        """The end as the filter has it now."""
        j0, w, w1, w2 = weights(np.array([self.u]), K)
        g = np.zeros((1, 10))
        cov = np.zeros((1, 3))
        filter_kernels.place(x, K, j0, w, w1, w2, g)
        filter_kernels.place_covariance(P, K, j0, w, cov, True)
        tangent, stretch = g[0, 2:4], float(g[0, 9])
        normal = np.array([-tangent[1], tangent[0]])
        jj = np.arange(4) + j0[0]
        turn = np.array([w1[0] @ x[2 * K + jj], w1[0] @ x[3 * K + jj]])
        return EndView(
            g[0, :2], self.sign * tangent, normal, g[0, 4:6], stretch, jj, w[0], w1[0],
            float(normal @ turn) / stretch, float(np.sqrt(max(cov[0, 0], cov[0, 2], 0.0))),
        )  # fmt: skip

    def measure(
        self,
        last: npt.NDArray[np.int64],
        t_us: int,
        dt_ms: float,
        x: FloatArray,
        P: FloatArray,
        K: int,
        centre: FloatArray,
        params: ChainParams,
        Ph: FloatArray,
        scratch: PatchScratch,
    ) -> None:
        """Match the end's events and absorb their shift; a silent patch in view is at rest."""
        self.measured = False
        self.surprise = 0.0
        self.events = 0
        if self.patch is not None:
            self._measure_patch(self.patch, last, t_us, dt_ms, x, P, K, centre, params, Ph, scratch)
        elif self.step_px is not None:
            self._measure_step(self.step_px, last, t_us, dt_ms, x, P, K, params, Ph, scratch)

    def _measure_patch(
        self, patch: EndPatch, last: npt.NDArray[np.int64], t_us: int, dt_ms: float, x: FloatArray, P: FloatArray, K: int,
        centre: FloatArray, params: ChainParams, Ph: FloatArray, scratch: PatchScratch,
    ) -> None:  # fmt: skip
        v = self.view(x, P, K)
        held = self.kind is EndKind.HELD
        e = 4 * K + EXTRAS_PER_END * self.which
        ratio = float(x[e + 2])
        origin = v.point + ratio * (v.point - centre) + x[e] * v.outward + x[e + 1] * v.normal
        middle = origin + 0.5 * (patch.a0 + patch.a1) * v.outward
        if not _within(middle, last, 10.0):
            return
        moves = (1.0 + ratio) * v.velocity
        speed = float(np.hypot(*moves))
        window = float(np.clip(params.window_px / max(speed + 0.5 * v.sigma_v, 1e-3), 1.5, params.window_max_ms))
        n = patch_kernels.collect(
            last, t_us, window, params.latency_us * 1e-3, origin, v.outward, v.normal, moves, v.rotation, self._box,
            scratch.a, scratch.d, scratch.p, scratch.age,
        )  # fmt: skip
        self.events = n
        if held and n < params.quiet_events and speed < 3.0:
            if window < _QUIET_MS:
                # Few events in a short window may be slow motion.
                n = patch_kernels.collect(
                    last, t_us, _QUIET_MS, params.latency_us * 1e-3, origin, v.outward, v.normal, 0.0 * moves, 0.0,
                    self._box, scratch.a, scratch.d, scratch.p, scratch.age,
                )  # fmt: skip
            if n < params.quiet_events:
                self._rest(v, x, P, K, dt_ms, Ph)
            return
        if self._resting_at is not None:
            # Where it starts from may be wrong by what was not seen when it came to rest: look widely again.
            self._resting_at = None
            self.acquired = 0
        if n < (100 if held else 40):
            return
        self.unmatched_ms += dt_ms
        sure = self.sure and self.unmatched_ms < _DOUBT_MS
        # Before it is known how fast the patch moves, only the newest events are sharp.
        target = (800 if sure else 300) if held else (300 if sure else 150)
        n = patch_kernels.newest(scratch.a, scratch.d, scratch.p, scratch.age, n, window, target, 1.0 if sure else 0.4)
        reach = (8 if sure else 22) if held else (8 if sure else 14)
        if sure and speed > 0.5:
            direction = np.array([moves @ v.outward, moves @ v.normal])
        else:
            patch_kernels.find_direction(
                self._lean_a, self._lean_d, _PAD, patch.a0, patch.dm, scratch.a, scratch.d, scratch.p, n, 200, reach,
                scratch.score, scratch.second, scratch.out,
            )  # fmt: skip
            direction = scratch.out[:2].copy()
        k = round(float(np.arctan2(direction[1], direction[0])) / (2.0 * np.pi) * _DIRECTIONS) % _DIRECTIONS
        patch_kernels.match(
            self._tables[k], _PAD, patch.a0, patch.dm, scratch.a, scratch.d, scratch.p, n, 500 if sure else 250,
            reach, reach if held else 3, scratch.score, scratch.out,
        )  # fmt: skip
        out = scratch.out
        if out[4] < 0.08 or out[5] < (4.0 if sure else 10.0):
            return
        mean_age = float(scratch.age[:n].mean())
        reuse = max(1.0, 2.0 * mean_age / dt_ms)
        index = np.empty(12, np.int64)
        h = np.zeros(12)
        for axis_index, axis in ((0, v.outward), (1, v.normal)):
            sigma = out[2 + axis_index]
            if sigma <= 0.0 or (axis_index == 1 and not held):
                continue
            jj = v.nodes
            index[:4], index[4:8] = jj, K + jj
            h[:4], h[4:8] = (1.0 + ratio) * v.w * axis[0], (1.0 + ratio) * v.w * axis[1]
            if axis_index == 1:
                lever = self.sign * float(scratch.a[:n].mean()) / v.stretch
                h[:4] += lever * v.w1 * v.normal[0]
                h[4:8] += lever * v.w1 * v.normal[1]
            index[8], h[8] = e + axis_index, 1.0
            index[9], h[9] = e + 2, float((v.point - centre) @ axis)
            rows = 10 if held else 8
            z = float(out[axis_index])
            R = (params.end_sigma_px**2 + 2.0 * sigma**2 + (0.15 * mean_age) ** 2) * reuse
            nis = z * z / (filter_kernels.row_variance(P, index, h, rows) + R)
            self.surprise = max(self.surprise, nis)
            if nis > _PATCH_GATE:
                continue
            filter_kernels.update(x, P, index, h, rows, z, R * (1.0 + 0.25 * nis), Ph)
            self.measured = True
        if self.measured:
            self.acquired += 1
            self.seen_ms += dt_ms
            self.unmatched_ms = 0.0

    def _rest(self, v: EndView, x: FloatArray, P: FloatArray, K: int, dt_ms: float, Ph: FloatArray) -> None:
        index = np.empty(8, np.int64)
        h = np.zeros(8)
        for axis in (v.outward, v.normal):
            index[:4], index[4:] = 2 * K + v.nodes, 3 * K + v.nodes
            h[:4], h[4:] = v.w * axis[0], v.w * axis[1]
            filter_kernels.update(x, P, index, h, 8, -float(v.velocity @ axis), 0.15**2 / dt_ms, Ph)
        if self._resting_at is None:
            index[:4], index[4:] = v.nodes, K + v.nodes
            h[:4], h[4:] = v.w, 0.0
            variance = filter_kernels.row_variance(P, index, h, 8)
            h[:4], h[4:] = 0.0, v.w
            variance = max(variance, filter_kernels.row_variance(P, index, h, 8), 1.0)
            self._resting_at = (v.point.copy(), v.outward.copy())
            self._resting_variance = variance
            return
        # What rests stays where it came to rest, and keeps its direction; that makes neither better known.
        place, outward = self._resting_at
        index[:4], index[4:] = v.nodes, K + v.nodes
        for axis in (v.outward, v.normal):
            h[:4], h[4:] = v.w * axis[0], v.w * axis[1]
            here = np.array([v.w @ x[v.nodes], v.w @ x[K + v.nodes]])
            R = self._resting_variance * _REST_MS / dt_ms
            filter_kernels.update(x, P, index, h, 8, float((place - here) @ axis), R, Ph)
        turn = float(v.outward[0] * outward[1] - v.outward[1] * outward[0])
        h[:4], h[4:] = v.w1 * v.normal[0] / v.stretch, v.w1 * v.normal[1] / v.stretch
        filter_kernels.update(x, P, index, h, 8, turn, 0.05**2 * _REST_MS / dt_ms, Ph)

    def _step(
        self, v: EndView, last: npt.NDArray[np.int64], t_us: int, params: ChainParams, scratch: PatchScratch
    ) -> bool:
        """Look for the place where events end; True with a clear one in ``scratch.out``."""
        speed = float(np.hypot(*v.velocity))
        if speed < 0.4:
            return False
        window = float(np.clip(params.window_px / speed, 1.0, params.window_max_ms))
        box = np.array([-_STEP_HALF, _STEP_HALF, self.radius_px + 3.0])
        n = patch_kernels.collect(
            last, t_us, window, params.latency_us * 1e-3, v.point, v.outward, v.normal, v.velocity, v.rotation, box,
            scratch.a, scratch.d, scratch.p, scratch.age,
        )  # fmt: skip
        self.events = n
        patch_kernels.find_step(scratch.a, n, _STEP_HALF, scratch.counts, scratch.out)
        return bool(scratch.out[1] > 12.0)

    def look_for_tip(
        self,
        u: float,
        last: npt.NDArray[np.int64],
        t_us: int,
        x: FloatArray,
        P: FloatArray,
        K: int,
        params: ChainParams,
        scratch: PatchScratch,
    ) -> bool:
        """Whether the DLO, coming in from beyond the image, is seen to end near ``u``; then this end becomes a tip."""
        if abs(u - self.u) > 1e-9:
            self._votes.clear()
        self.u = u
        v = self.view(x, P, K)
        if not _within(v.point + (_STEP_HALF + 6.0) * v.outward, last, 2.0):
            return False
        if not self._step(v, last, t_us, params, scratch):
            return False
        self._votes.append((float(scratch.out[0]), v.point.copy()))
        recent = [vote[0] for vote in self._votes[-6:]]
        if len(recent) < 6 or max(recent) - min(recent) > 6.0:
            return False
        # An end that the frame took for hidden must have travelled: what hides it would have stayed where it is.
        travel = float(np.hypot(*(v.point - self._votes[0][1])))
        if self.kind is EndKind.HIDDEN and travel < _HIDDEN_TRAVEL_PX:
            return False
        self.kind = EndKind.TIP
        self.u = u + float(np.median(recent)) / v.stretch
        self.step_px = 0.0
        return True

    def _measure_step(
        self, step_px: float, last: npt.NDArray[np.int64], t_us: int, dt_ms: float, x: FloatArray, P: FloatArray, K: int,
        params: ChainParams, Ph: FloatArray, scratch: PatchScratch,
    ) -> None:  # fmt: skip
        v = self.view(x, P, K)
        if not _within(v.point, last, _STEP_HALF) or not self._step(v, last, t_us, params, scratch):
            return
        z = float(scratch.out[0]) - step_px
        index = np.empty(8, np.int64)
        index[:4], index[4:] = v.nodes, K + v.nodes
        h = np.concatenate([v.w * v.outward[0], v.w * v.outward[1]])
        R = 2.0**2 * max(1.0, params.window_px / max(float(np.hypot(*v.velocity)), 0.5) / dt_ms)
        nis = z * z / (filter_kernels.row_variance(P, index, h, 8) + R)
        if nis > 25.0:
            return
        filter_kernels.update(x, P, index, h, 8, z, R * (1.0 + 0.25 * nis), Ph)
        self.measured = True
        self.seen_ms += dt_ms


def _within(point: FloatArray, last: npt.NDArray[np.int64], rim: float) -> bool:
    height, width = last.shape[1:]
    return bool(rim <= point[0] < width - rim and rim <= point[1] < height - rim)
