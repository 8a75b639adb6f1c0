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

EXTRAS_PER_END = 3
"""Filter states of an end: offset of the patch along the outward tangent and the left normal (px), height ratio."""

_PAD = 24
_REBUILD_COS = np.cos(np.radians(8.0))


@dataclass
class PatchScratch:
    """Buffers that all ends of all chains share."""

    a: FloatArray = field(default_factory=lambda: np.zeros(patch_kernels.MAX_EVENTS))
    d: FloatArray = field(default_factory=lambda: np.zeros(patch_kernels.MAX_EVENTS))
    p: npt.NDArray[np.int64] = field(default_factory=lambda: np.zeros(patch_kernels.MAX_EVENTS, np.int64))
    age: FloatArray = field(default_factory=lambda: np.zeros(patch_kernels.MAX_EVENTS))
    score: npt.NDArray[np.float32] = field(
        default_factory=lambda: np.zeros((2 * _PAD + 1, 2 * _PAD + 1), dtype=np.float32)
    )
    out: FloatArray = field(default_factory=lambda: np.zeros(7))


class End:
    """One end of a chain with its patch; measures shift of the patch against the prediction."""

    def __init__(
        self, kind: EndKind, which: int, look: Appearance | None, length_px: float, radius_px: float, u: float
    ) -> None:
        self.kind = kind
        self.which = which
        self.u = u
        """Material coordinate at which the segmented shape ended: the patch's origin."""
        self.sign = -1.0 if which == 0 else 1.0
        self.patch: EndPatch | None = None
        self.acquired = 0
        """Matches absorbed so far."""
        self.quiet_ms = 0.0
        self.measured = False
        self.events = 0
        if look is not None:
            if kind is EndKind.HELD:
                self.patch = end_patch(look, which, length_px, 6.0, 78.0, 46.0)
            elif kind in (EndKind.TIP, EndKind.UNKNOWN):
                self.patch = end_patch(look, which, length_px, -26.0, 20.0, radius_px + 8.0)
        if self.patch is not None and self.patch.strength < 0.01:
            self.patch = None
        if self.patch is not None:
            rows, columns = self.patch.grad_a.shape
            self._density = np.zeros((2, rows, columns), np.float32)
            self._table = np.zeros((2, rows + 2 * _PAD, columns + 2 * _PAD), np.float32)
            self._box = np.array([self.patch.a0, self.patch.a1, self.patch.dm])
        self._built_for = np.zeros(2)

    def prior(self, params: ChainParams) -> tuple[FloatArray, FloatArray]:
        """Means and variances of the end's extras."""
        if self.kind is EndKind.HELD:
            return np.array([0.0, 0.0, params.height_ratio]), np.array([100.0, 100.0, params.height_ratio_sigma**2])
        return np.zeros(3), np.array([0.25, 0.25, 1e-10])

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
        """Match the patch and absorb its shift; a silent patch in view is at rest."""
        self.measured = False
        self.events = 0
        if self.patch is None:
            return
        j0, w, w1, w2 = weights(np.array([self.u]), K)
        g = np.zeros((1, 10))
        filter_kernels.place(x, K, j0, w, w1, w2, g)
        point, tangent, velocity, stretch = g[0, :2], g[0, 2:4], g[0, 4:6], g[0, 9]
        outward = self.sign * tangent
        normal = np.array([-tangent[1], tangent[0]])
        e = 4 * K + EXTRAS_PER_END * self.which
        ratio = x[e + 2]
        origin = point + ratio * (point - centre) + x[e] * outward + x[e + 1] * normal
        middle = origin + 0.5 * (self.patch.a0 + self.patch.a1) * outward
        height, width = last.shape[1:]
        if not (10 <= middle[0] < width - 10 and 10 <= middle[1] < height - 10):
            return
        jj = np.arange(4) + j0[0]
        rotation = float(normal @ np.array([w1[0] @ x[2 * K + jj], w1[0] @ x[3 * K + jj]]) / stretch)
        moves = (1.0 + ratio) * velocity
        speed = float(np.hypot(*moves))
        cov = np.zeros((1, 3))
        filter_kernels.place_covariance(P, K, j0, w, cov, True)
        sigma_v = float(np.sqrt(max(cov[0, 0], cov[0, 2])))
        window = float(np.clip(params.window_px / max(speed + 0.5 * sigma_v, 1e-3), 1.5, params.window_max_ms))
        n = patch_kernels.collect(
            last, t_us, window, params.latency_us * 1e-3, origin, outward, normal, moves, rotation, self._box,
            scratch.a, scratch.d, scratch.p, scratch.age,
        )  # fmt: skip
        self.events = n
        held = self.kind is EndKind.HELD
        index = np.empty(12, np.int64)
        h = np.zeros(12)
        if held and n < 0.01 * self._density[0].size * self.patch.strength * 4 and speed < 2.0:
            for axis in (outward, normal):
                index[:4], index[4:8] = 2 * K + jj, 3 * K + jj
                h[:4], h[4:8] = w[0] * axis[0], w[0] * axis[1]
                filter_kernels.update(x, P, index, h, 8, -float(velocity @ axis), 0.15**2 / dt_ms, Ph)
            return
        if n < (120 if held else 40) or speed < 0.15:
            return
        direction = np.array([moves @ outward, moves @ normal]) / speed
        if direction @ self._built_for < _REBUILD_COS:
            patch_kernels.build_table(
                self.patch.grad_a, self.patch.grad_d, direction[0], direction[1], _PAD, self._density, self._table
            )
            self._built_for = direction
        reach = 18 if held and self.acquired < 5 else 8
        patch_kernels.match(
            self._table, _PAD, self.patch.a0, self.patch.dm, scratch.a, scratch.d, scratch.p, n, 500,
            reach, reach if held else 3, scratch.score, scratch.out,
        )  # fmt: skip
        out = scratch.out
        if out[4] < 0.05 or out[5] < 3.0:
            return
        mean_age = float(scratch.age[:n].mean())
        reuse = max(1.0, window / dt_ms)
        for axis_index, axis in ((0, outward), (1, normal)):
            if axis_index == 1 and not held:
                break
            sigma = out[2 + axis_index]
            if sigma <= 0.0:
                continue
            index[:4], index[4:8] = jj, K + jj
            h[:4], h[4:8] = (1.0 + ratio) * w[0] * axis[0], (1.0 + ratio) * w[0] * axis[1]
            if axis_index == 1:
                lever = self.sign * float(scratch.a[:n].mean()) / stretch
                h[:4] += lever * w1[0] * normal[0]
                h[4:8] += lever * w1[0] * normal[1]
            index[8], h[8] = e + axis_index, 1.0
            index[9], h[9] = e + 2, float((point - centre) @ axis)
            k = 10 if held else 8
            z = out[axis_index]
            R = (params.end_sigma_px**2 + 2.0 * sigma**2 + (0.15 * mean_age) ** 2) * reuse
            s = filter_kernels.row_variance(P, index, h, k) + R
            nis = z * z / s
            if nis > 25.0:
                continue
            filter_kernels.update(x, P, index, h, k, z, R * (1.0 + 0.25 * nis), Ph)
            self.measured = True
        self.acquired += int(self.measured)
