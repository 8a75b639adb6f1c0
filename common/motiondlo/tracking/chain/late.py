"""Late corrections: a frame's shape as an innovation at its own time, carried forward along the material coordinate."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from motiondlo.frames.types import EndKind
from motiondlo.geometry.curve import point_at, project
from motiondlo.tracking.chain import filter_kernels
from motiondlo.tracking.chain.chain import Chain
from motiondlo.tracking.chain.filter_state import ChainFilter
from motiondlo.tracking.chain.spline import weights
from motiondlo.tracking.types import Correction

FloatArray = npt.NDArray[np.float64]

_CALIBRATION_SIGMA_PX = 1.0
"""Smooth error of the homography, which all frames share."""
_TIP_SIGMA_PX = 3.0
_GATE = 36.0
_FADE_MS = 15.0
_LEAST_LASTING = 0.2
_RIM_PX = 12.0


@dataclass(frozen=True)
class PastShape:
    """A chain at a past time: enough to compare a frame's shape with."""

    nodes: FloatArray
    """(K, 2) control nodes."""
    seen_ms: FloatArray
    """(S,) for how long each station had been measured by then."""
    ends_seen_ms: tuple[float, float]
    """The same of both ends."""

    @staticmethod
    def of(chain: Chain) -> PastShape:
        """The chain as it is now."""
        return PastShape(
            chain.filter.nodes(),
            chain.stations.seen_ms.copy(),
            (chain.ends[0].seen_ms, chain.ends[1].seen_ms),
        )

    def points(self, u: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Points and unit tangents at material coordinates ``u``."""
        K = len(self.nodes)
        j0, w, w1, _ = weights(np.clip(u, 0.0, K - 3.0), K)
        local = self.nodes[j0[:, None] + np.arange(4)]
        t = (w1[:, :, None] * local).sum(axis=1)
        return (w[:, :, None] * local).sum(axis=1), t / np.maximum(np.hypot(t[:, 0], t[:, 1]), 1e-9)[:, None]


def absorb(chain: Chain, past: PastShape, correction: Correction) -> Callable[[PastShape], PastShape] | None:
    """Blend a frame's shape into the chain; None where it is implausible.

    Offsets at the frame's time, in the curve's own normal and tangential directions, are taken as measurements of the
    same material places now. Returns the change that the history since then needs.
    """
    f, stations = chain.filter, chain.stations
    K = f.K
    u = np.arange(np.ceil(chain.u_first), np.floor(chain.u_last) + 0.5)
    then, t_then = past.points(u)
    shape = np.asarray(correction.nodes, dtype=np.float64)
    distance, s = project(then, shape)
    length = float(np.hypot(*np.diff(shape, axis=0).T).sum())
    nearest = point_at(shape, s)
    n_then = np.stack([-t_then[:, 1], t_then[:, 0]], axis=1)
    offset = ((nearest - then) * n_then).sum(axis=1)
    # Places past an end of the frame's shape have no counterpart in it.
    faced = (s > 1e-6) & (s < length - 1e-6) & (distance < 10.0 * chain.diameter_px)
    sigma = np.interp(s, np.linspace(0.0, length, len(shape)), correction.sigma_normal_px)

    j0, w, w1, w2 = weights(u, K)
    g = np.zeros((len(u), 10))
    cov = np.zeros((len(u), 3))
    filter_kernels.place(f.x, K, j0, w, w1, w2, g)
    filter_kernels.place_covariance(f.P, K, j0, w, cov, False)
    tx, ty = g[:, 2], g[:, 3]
    own = ty**2 * cov[:, 0] - 2 * tx * ty * cov[:, 1] + tx**2 * cov[:, 2]
    # The frame's errors agree over about three node distances.
    R = 3.0 * (sigma**2 + _CALIBRATION_SIGMA_PX**2) + own
    if faced.sum() < 3:
        return None
    if float(np.median(offset[faced] ** 2 / (R + own)[faced])) > _GATE:
        return None
    before = f.nodes()
    # What events have measured since then is better known than by the frame: an old error is gone there.
    lasting = np.exp(-np.interp(u, stations.u, stations.seen_ms - past.seen_ms) / _FADE_MS)
    ends = _end_rows(chain, past, correction, shape)
    for k in np.flatnonzero(faced & (lasting > _LEAST_LASTING)):
        _apply(f, j0[k], w[k], np.array([-ty[k], tx[k]]), float(lasting[k] * offset[k]), float(R[k]))
    for jj, ww, axis, z, variance in ends:
        _apply(f, jj, ww, axis, z, variance)
    chain.touch()
    delta = f.nodes() - before

    def change(state: PastShape) -> PastShape:
        return replace(state, nodes=state.nodes + delta)

    return change


def _apply(f: ChainFilter, j0: int, w: FloatArray, axis: FloatArray, z: float, R: float) -> None:
    """One offset ``z`` along ``axis`` at a place; an innovation beyond three sigma is taken with less weight."""
    index = np.concatenate([j0 + np.arange(4), f.K + j0 + np.arange(4)]).astype(np.int64)
    h = np.concatenate([w * axis[0], w * axis[1]])
    nis = z * z / (f.variance_of(index, h, 8) + R)
    f.absorb(index, h, 8, z, R * (1.0 + max(nis - 9.0, 0.0)))


def _end_rows(
    chain: Chain, past: PastShape, correction: Correction, shape: FloatArray
) -> list[tuple[int, FloatArray, FloatArray, float, float]]:
    """Tangential offsets of free tips that both the chain and the frame show."""
    rows: list[tuple[int, FloatArray, FloatArray, float, float]] = []
    u_ends = np.array([chain.u_first, chain.u_last])
    then, t_then = past.points(u_ends)
    same = np.hypot(*(shape[0] - then[0])) + np.hypot(*(shape[-1] - then[1])) <= np.hypot(
        *(shape[-1] - then[0])
    ) + np.hypot(*(shape[0] - then[1]))
    for k in (0, 1):
        m = k if same else 1 - k
        if chain.ends[k].kind is not EndKind.TIP or correction.ends[m] is not EndKind.TIP:
            continue
        tip = shape[0] if m == 0 else shape[-1]
        width, height = chain.geometry.width_px, chain.geometry.height_px
        if not (_RIM_PX < tip[0] < width - _RIM_PX and _RIM_PX < tip[1] < height - _RIM_PX):
            continue
        lasting = float(np.exp(-(chain.ends[k].seen_ms - past.ends_seen_ms[k]) / _FADE_MS))
        if lasting < _LEAST_LASTING:
            continue
        z = lasting * float((tip - then[k]) @ t_then[k])
        j0, w, w1, _ = weights(u_ends[k : k + 1], chain.filter.K)
        t = w1[0] @ chain.filter.nodes()[j0[0] : j0[0] + 4]
        sigma = correction.sigma_tangent_px[0 if m == 0 else -1]
        rows.append((int(j0[0]), w[0], t / max(np.hypot(*t), 1e-9), z, float(sigma**2 + _TIP_SIGMA_PX**2)))
    return rows


def carried_forward(correction: Correction, chain: Chain, past: PastShape) -> Correction:
    """The correction's shape moved as the chain moved between the frame's time and now."""
    u = np.linspace(chain.u_first, chain.u_last, 60)
    then, _ = past.points(u)
    now, _ = PastShape.of(chain).points(u)
    shape = np.asarray(correction.nodes, dtype=np.float64)
    _, s = project(shape, then)
    knots = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(then, axis=0).T))])
    motion = now - then
    moved = shape + np.stack([np.interp(s, knots, motion[:, 0]), np.interp(s, knots, motion[:, 1])], axis=1)
    return replace(correction, nodes=moved)
