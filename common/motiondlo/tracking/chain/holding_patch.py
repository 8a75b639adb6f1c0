"""A rigid patch at an end: match its events with the frame's gradients, and tell the filter.

A gripper's patch moves with the end but stands higher: its place is the end's, magnified about the image's middle by
its height ratio, plus an offset in the end's own frame (its parallax between both cameras). Both are states of the
filter. A tip's patch is the DLO itself.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from motiondlo.tracking.chain import patch_kernels
from motiondlo.tracking.chain.end_view import SEARCH_PAD_PX, EndView, PatchScratch
from motiondlo.tracking.chain.filter_state import ChainFilter
from motiondlo.tracking.chain.params import ChainParams
from motiondlo.tracking.chain.templates import EndPatch

FloatArray = npt.NDArray[np.float64]
Surface = npt.NDArray[np.int64]

_DIRECTIONS = 16
_LEAST_LLR = 0.08
_LEAST_LEAD_SURE = 4.0
_LEAST_LEAD = 10.0
_KNOWN_SPEED_PX_MS = 0.5


@dataclass(frozen=True)
class Search:
    """How far and with how many events a patch is looked for."""

    least: int
    newest_sure: int
    newest: int
    reach_sure: int
    reach: int
    side: int | None
    """Reach along the normal; None: as far as along the tangent."""


GRIPPER = Search(least=100, newest_sure=800, newest=300, reach_sure=8, reach=22, side=None)
TIP = Search(least=40, newest_sure=300, newest=150, reach_sure=8, reach=14, side=3)


@dataclass(frozen=True)
class Placed:
    """The patch as predicted: where its origin is and how it moves."""

    origin: FloatArray
    velocity: FloatArray
    window_ms: float

    @property
    def speed(self) -> float:
        """px/ms."""
        return float(np.hypot(self.velocity[0], self.velocity[1]))


class HoldingPatch:
    """Tables of one patch for all directions of motion, and its match."""

    def __init__(self, patch: EndPatch, search: Search) -> None:
        self.patch = patch
        self.search = search
        rows, columns = patch.grad_a.shape
        pad = SEARCH_PAD_PX
        self._tables = np.zeros((_DIRECTIONS, 2, rows + 2 * pad, columns + 2 * pad), np.float32)
        density = np.zeros((2, rows, columns), np.float32)
        for k in range(_DIRECTIONS):
            angle = 2.0 * np.pi * k / _DIRECTIONS
            patch_kernels.build_table(
                patch.grad_a, patch.grad_d, float(np.cos(angle)), float(np.sin(angle)), pad, density, self._tables[k]
            )
        magnitude = np.hypot(patch.grad_a, patch.grad_d)
        scale = np.where(magnitude > 0.03, 1.0 / np.sqrt(np.maximum(magnitude, 1e-6)), 0.0)
        self._lean_a = np.pad(patch.grad_a * scale, pad).astype(np.float32)
        self._lean_d = np.pad(patch.grad_d * scale, pad).astype(np.float32)
        self._box = np.array([patch.a0, patch.a1, patch.dm])

    def place(self, v: EndView, extras: FloatArray, centre: FloatArray, p: ChainParams) -> Placed:
        """extras (3,): offsets and height ratio; centre (2,): the image's middle."""
        ratio = float(extras[2])
        origin = v.point + ratio * (v.point - centre) + extras[0] * v.outward + extras[1] * v.normal
        velocity = (1.0 + ratio) * v.velocity
        speed = float(np.hypot(velocity[0], velocity[1]))
        window = float(np.clip(p.window_px / max(speed + 0.5 * v.sigma_v, 1e-3), 1.5, p.window_max_ms))
        return Placed(origin, velocity, window)

    def middle(self, placed: Placed, v: EndView) -> FloatArray:
        """(2,) px, the middle of the patch."""
        return np.asarray(placed.origin + 0.5 * (self.patch.a0 + self.patch.a1) * v.outward)

    def collect(
        self, placed: Placed, v: EndView, last: Surface, t_us: int, p: ChainParams, scratch: PatchScratch
    ) -> int:
        """Events of the patch in its window, moved along with it; how many there are."""
        return int(
            patch_kernels.collect(
                last, t_us, placed.window_ms, p.latency_us * 1e-3, placed.origin, v.outward, v.normal, placed.velocity,
                v.rotation, self._box, scratch.a, scratch.d, scratch.p, scratch.age,
            )
        )  # fmt: skip

    def still_events(
        self,
        placed: Placed,
        v: EndView,
        last: Surface,
        t_us: int,
        window_ms: float,
        p: ChainParams,
        scratch: PatchScratch,
    ) -> int:
        """How many events there are in a window of its own, without any motion."""
        return int(
            patch_kernels.collect(
                last, t_us, window_ms, p.latency_us * 1e-3, placed.origin, v.outward, v.normal, np.zeros(2), 0.0,
                self._box, scratch.a, scratch.d, scratch.p, scratch.age,
            )
        )  # fmt: skip

    def match(self, placed: Placed, v: EndView, n: int, sure: bool, scratch: PatchScratch) -> int:
        """Find the shift of ``n`` collected events; how many of them were kept, 0 without a clear shift.

        The result is in ``scratch.out`` (``patch_kernels.match``). Before it is known how fast the patch moves, only
        the newest events are sharp, and its direction must be found as well.
        """
        s, pad, patch = self.search, SEARCH_PAD_PX, self.patch
        target = s.newest_sure if sure else s.newest
        n = patch_kernels.newest(
            scratch.a, scratch.d, scratch.p, scratch.age, n, placed.window_ms, target, 1.0 if sure else 0.4
        )
        reach = s.reach_sure if sure else s.reach
        if sure and placed.speed > _KNOWN_SPEED_PX_MS:
            along, across = float(placed.velocity @ v.outward), float(placed.velocity @ v.normal)
        else:
            patch_kernels.find_direction(
                self._lean_a, self._lean_d, pad, patch.a0, patch.dm, scratch.a, scratch.d, scratch.p, n, 200, reach,
                scratch.score, scratch.second, scratch.out,
            )  # fmt: skip
            along, across = float(scratch.out[0]), float(scratch.out[1])
        k = round(float(np.arctan2(across, along)) / (2.0 * np.pi) * _DIRECTIONS) % _DIRECTIONS
        patch_kernels.match(
            self._tables[k], pad, patch.a0, patch.dm, scratch.a, scratch.d, scratch.p, n, 500 if sure else 250,
            reach, reach if s.side is None else s.side, scratch.score, scratch.out,
        )  # fmt: skip
        clear = scratch.out[4] >= _LEAST_LLR and scratch.out[5] >= (_LEAST_LEAD_SURE if sure else _LEAST_LEAD)
        return n if clear else 0

    def absorb(
        self, f: ChainFilter, v: EndView, e: int, n: int, sign: float, centre: FloatArray, dt_ms: float, gate: float,
        scratch: PatchScratch,
    ) -> tuple[bool, float]:  # fmt: skip
        """Give the matched shift to the filter, whose extras of this end begin at ``e``.

        Returns whether anything was absorbed, and the largest normalised innovation squared.
        """
        out, K = scratch.out, f.K
        ratio = float(f.x[e + 2])
        gripper = self.search.side is None
        mean_age = float(scratch.age[:n].mean())
        reuse = max(1.0, 2.0 * mean_age / dt_ms)
        index, h = np.empty(10, np.int64), np.zeros(10)
        index[:4], index[4:8], index[9] = v.nodes, K + v.nodes, e + 2
        absorbed, surprise = False, 0.0
        for k, axis in enumerate((v.outward, v.normal) if gripper else (v.outward,)):
            sigma = float(out[2 + k])
            if sigma <= 0.0:
                continue
            h[:4], h[4:8] = (1.0 + ratio) * v.w * axis[0], (1.0 + ratio) * v.w * axis[1]
            if k == 1:
                # The events lie away from the end: its direction moves them sideways.
                lever = sign * float(scratch.a[:n].mean()) / v.stretch
                h[:4] += lever * v.w1 * v.normal[0]
                h[4:8] += lever * v.w1 * v.normal[1]
            index[8], h[8] = e + k, 1.0
            h[9] = float((v.point - centre) @ axis)
            rows = 10 if gripper else 8
            z = float(out[k])
            R = (f.params.end_sigma_px**2 + 2.0 * sigma**2 + (0.15 * mean_age) ** 2) * reuse
            nis = z * z / (f.variance_of(index, h, rows) + R)
            surprise = max(surprise, nis)
            if nis <= gate:
                f.absorb(index, h, rows, z, R * (1.0 + 0.25 * nis))
                absorbed = True
        return absorbed, surprise
