"""The ends of a chain: what holds it (a gripper, higher than the cable), its free tip, or the border of what is seen.

The tangential direction is measured hardly anywhere else: edges along the cable show only motion along their normals.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from motiondlo.frames.types import Appearance, EndKind
from motiondlo.tracking.chain import patch_kernels
from motiondlo.tracking.chain.end_view import STEP_HALF_PX, EndView, PatchScratch, view_end, within
from motiondlo.tracking.chain.filter_state import ChainFilter
from motiondlo.tracking.chain.holding_patch import GRIPPER, TIP, HoldingPatch, Placed
from motiondlo.tracking.chain.params import ChainParams
from motiondlo.tracking.chain.templates import end_patch

FloatArray = npt.NDArray[np.float64]
Surface = npt.NDArray[np.int64]

_GRIPPER_BOX_PX = (6.0, 78.0, 46.0)
_TIP_INWARD_PX = 26.0
_TIP_OUTWARD_PX = 20.0
_TIP_SIDE_PX = 8.0
_LEAST_STRENGTH = 0.01
_TIP_OFFSET_VARIANCE = 0.25

_SURE_MATCHES = 5
_DOUBT_MS = 4.0
"""Without a match for so long a patch is looked for widely again."""
_GATE = 60.0
_STEP_GATE = 25.0
_STEP_SIGMA_PX = 2.0
_STEP_GAIN = 12.0
_STEP_PX_MS = 0.4
_STEP_VOTES = 6
_STEP_SPREAD_PX = 6.0
_HIDDEN_TRAVEL_PX = 60.0

_QUIET_MS = 5.0
_QUIET_PX_MS = 3.0
_REST_MS = 20.0
"""Rest that counts as one more look at where it is."""
_REST_SIGMA = 0.15
_REST_TURN_RAD = 0.05


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
        self.patch: HoldingPatch | None = None
        self.step_found = False
        """For a tip without a patch: it is where events end."""
        self.acquired = 0
        """Matches absorbed since the patch was last unknown."""
        self.measured = False
        self.surprise = 0.0
        """Largest normalised innovation squared of the last update."""
        self.seen_ms = 0.0
        self.unmatched_ms = 0.0
        """How long the patch has made events that fit it nowhere."""
        self.events = 0
        self._votes: list[tuple[float, FloatArray]] = []
        self._resting_at: tuple[FloatArray, FloatArray] | None = None
        """Place and tangent at which a silent gripper came to rest."""
        self._resting_variance = 1.0
        if look is None:
            return
        if kind is EndKind.HELD:
            patch, search = end_patch(look, which, length_px, *_GRIPPER_BOX_PX), GRIPPER
        elif kind in (EndKind.TIP, EndKind.UNKNOWN):
            side = radius_px + _TIP_SIDE_PX
            patch, search = end_patch(look, which, length_px, -_TIP_INWARD_PX, _TIP_OUTWARD_PX, side, radius_px), TIP
        else:
            return
        if patch.strength >= _LEAST_STRENGTH:
            self.patch = HoldingPatch(patch, search)

    @property
    def sure(self) -> bool:
        """Whether the patch was matched often enough to trust where it is."""
        return self.acquired >= _SURE_MATCHES

    def prime(self, f: ChainFilter) -> None:
        """Set the end's extras in the filter to what is known of them before any event."""
        e, p = f.extras(self.which), f.params
        offset_variance, ratio, ratio_variance = _TIP_OFFSET_VARIANCE, 0.0, 1e-10
        if self.kind is EndKind.HELD:
            offset_variance = p.patch_offset_sigma_px**2
            ratio, ratio_variance = p.height_ratio, p.height_ratio_sigma**2
        f.x[e : e + 3] = (0.0, 0.0, ratio)
        f.P[e : e + 3, e : e + 3] = np.diag([offset_variance, offset_variance, ratio_variance])

    def view(self, f: ChainFilter) -> EndView:
        """The end as the filter has it now."""
        return view_end(f, self.u, self.sign)

    def measure(
        self, f: ChainFilter, last: Surface, t_us: int, dt_ms: float, centre: FloatArray, scratch: PatchScratch
    ) -> None:
        """Match the end's events and absorb their shift; a silent gripper in view is at rest."""
        self.measured = False
        self.surprise = 0.0
        self.events = 0
        if self.patch is not None:
            self._measure_patch(self.patch, f, last, t_us, dt_ms, centre, scratch)
        elif self.step_found:
            self._measure_step(f, last, t_us, dt_ms, scratch)

    # patch

    def _measure_patch(
        self, patch: HoldingPatch, f: ChainFilter, last: Surface, t_us: int, dt_ms: float, centre: FloatArray,
        scratch: PatchScratch,
    ) -> None:  # fmt: skip
        p = f.params
        e = f.extras(self.which)
        v = self.view(f)
        placed = patch.place(v, f.x[e : e + 3], centre, p)
        if not within(patch.middle(placed, v), last, 10.0):
            return
        n = self.events = patch.collect(placed, v, last, t_us, p, scratch)
        if self.kind is EndKind.HELD and n < p.quiet_events and placed.speed < _QUIET_PX_MS:
            if self._is_quiet(patch, placed, v, last, t_us, p, scratch):
                self._rest(f, v, dt_ms)
            return
        if self._resting_at is not None:
            # Where it starts from may be wrong by what was not seen when it came to rest: look widely again.
            self._resting_at = None
            self.acquired = 0
        if n < patch.search.least:
            return
        self.unmatched_ms += dt_ms
        n = patch.match(placed, v, n, self.sure and self.unmatched_ms < _DOUBT_MS, scratch)
        if n == 0:
            return
        self.measured, self.surprise = patch.absorb(f, v, e, n, self.sign, centre, dt_ms, _GATE, scratch)
        if self.measured:
            self.acquired += 1
            self.seen_ms += dt_ms
            self.unmatched_ms = 0.0

    def _is_quiet(
        self, patch: HoldingPatch, placed: Placed, v: EndView, last: Surface, t_us: int, p: ChainParams,
        scratch: PatchScratch,
    ) -> bool:  # fmt: skip
        """Few events in a short window may be slow motion: look again in a longer one."""
        if placed.window_ms >= _QUIET_MS:
            return True
        return patch.still_events(placed, v, last, t_us, _QUIET_MS, p, scratch) < p.quiet_events

    def _rest(self, f: ChainFilter, v: EndView, dt_ms: float) -> None:
        K = f.K
        index, h = np.empty(8, np.int64), np.zeros(8)
        index[:4], index[4:] = 2 * K + v.nodes, 3 * K + v.nodes
        for axis in (v.outward, v.normal):
            h[:4], h[4:] = v.w * axis[0], v.w * axis[1]
            f.absorb(index, h, 8, -float(v.velocity @ axis), _REST_SIGMA**2 / dt_ms)
        index[:4], index[4:] = v.nodes, K + v.nodes
        if self._resting_at is None:
            variances = []
            for weights_x, weights_y in ((v.w, 0.0 * v.w), (0.0 * v.w, v.w)):
                h[:4], h[4:] = weights_x, weights_y
                variances.append(f.variance_of(index, h, 8))
            self._resting_at = (v.point.copy(), v.outward.copy())
            self._resting_variance = max(*variances, 1.0)
            return
        # What rests stays where it came to rest, and keeps its direction; that makes neither better known.
        place, outward = self._resting_at
        for axis in (v.outward, v.normal):
            h[:4], h[4:] = v.w * axis[0], v.w * axis[1]
            here = np.array([v.w @ f.x[v.nodes], v.w @ f.x[K + v.nodes]])
            f.absorb(index, h, 8, float((place - here) @ axis), self._resting_variance * _REST_MS / dt_ms)
        turn = float(v.outward[0] * outward[1] - v.outward[1] * outward[0])
        h[:4], h[4:] = v.w1 * v.normal[0] / v.stretch, v.w1 * v.normal[1] / v.stretch
        f.absorb(index, h, 8, turn, _REST_TURN_RAD**2 * _REST_MS / dt_ms)

    # where events end

    def _find_step(self, v: EndView, last: Surface, t_us: int, p: ChainParams, scratch: PatchScratch) -> bool:
        """Look for the place where events end; True with a clear one in ``scratch.out``."""
        if v.speed < _STEP_PX_MS:
            return False
        window = float(np.clip(p.window_px / v.speed, 1.0, p.window_max_ms))
        box = np.array([-STEP_HALF_PX, STEP_HALF_PX, self.radius_px + 3.0])
        n = patch_kernels.collect(
            last, t_us, window, p.latency_us * 1e-3, v.point, v.outward, v.normal, v.velocity, v.rotation, box,
            scratch.a, scratch.d, scratch.p, scratch.age,
        )  # fmt: skip
        self.events = n
        patch_kernels.find_step(scratch.a, n, STEP_HALF_PX, scratch.counts, scratch.out)
        return bool(scratch.out[1] > _STEP_GAIN)

    def look_for_tip(self, u: float, f: ChainFilter, last: Surface, t_us: int, scratch: PatchScratch) -> bool:
        """Whether the DLO, coming in from beyond the image, is seen to end near ``u``; then this end becomes a tip."""
        if abs(u - self.u) > 1e-9:
            self._votes.clear()
        self.u = u
        v = self.view(f)
        if not within(v.point + (STEP_HALF_PX + 6.0) * v.outward, last, 2.0):
            return False
        if not self._find_step(v, last, t_us, f.params, scratch):
            return False
        self._votes.append((float(scratch.out[0]), v.point.copy()))
        recent = [vote[0] for vote in self._votes[-_STEP_VOTES:]]
        if len(recent) < _STEP_VOTES or max(recent) - min(recent) > _STEP_SPREAD_PX:
            return False
        # An end that the frame took for hidden must have travelled: what hides it would have stayed where it is.
        travel = v.point - self._votes[0][1]
        if self.kind is EndKind.HIDDEN and float(np.hypot(travel[0], travel[1])) < _HIDDEN_TRAVEL_PX:
            return False
        self.kind = EndKind.TIP
        self.u = u + self.sign * float(np.median(recent)) / v.stretch
        self.step_found = True
        return True

    def _measure_step(self, f: ChainFilter, last: Surface, t_us: int, dt_ms: float, scratch: PatchScratch) -> None:
        v = self.view(f)
        if not within(v.point, last, STEP_HALF_PX) or not self._find_step(v, last, t_us, f.params, scratch):
            return
        z = float(scratch.out[0])
        index = np.empty(8, np.int64)
        index[:4], index[4:] = v.nodes, f.K + v.nodes
        h = np.concatenate([v.w * v.outward[0], v.w * v.outward[1]])
        R = _STEP_SIGMA_PX**2 * max(1.0, f.params.window_px / v.speed / dt_ms)
        nis = z * z / (f.variance_of(index, h, 8) + R)
        if nis <= _STEP_GATE:
            f.absorb(index, h, 8, z, R * (1.0 + 0.25 * nis))
            self.measured = True
            self.seen_ms += dt_ms
