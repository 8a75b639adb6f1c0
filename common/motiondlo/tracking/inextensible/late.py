"""Late corrections: a shape of the frame branch against the state at its time, carried forward to now.

The innovation at t0 is taken along the normal of the curve held then, station by station of the material coordinate.
What it says about now depends on what was seen since: the error that a station had at t0 is the error that it has now
only where nothing was measured in between. ``seen_ms`` counts how long every station was measured; the share of the old
error that is left fades with it, and the variance of the correction grows by the inverse square of that share.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from motiondlo.frames.types import EndKind, FloatArray
from motiondlo.geometry.curve import arc_length, left_normals, project, resample, tangents
from motiondlo.tracking.types import Correction

_GATE_SIGMA = 5.0
_SMALLEST_SHARE = 0.02


@dataclass(frozen=True)
class PastState:
    """What a late correction is compared with: the curve at one time, at the stations."""

    points: FloatArray
    """(m, 2) px."""
    sigma_normal_px: FloatArray
    """(m,)."""
    seen_ms: FloatArray
    """(m,) time for which every station had been measured."""
    end_seen_ms: tuple[float, float]
    ends_s_px: tuple[float, float]
    """Material coordinates of both ends."""


@dataclass(frozen=True)
class CarriedInnovation:
    """Normal offsets of the stations at now, with their variances; infinite where the correction says nothing."""

    offset_px: FloatArray
    """(m,)."""
    variance_px2: FloatArray
    """(m,)."""
    end_shift_px: tuple[float, float]
    """How far the correction's tips lie beyond the held ones, along the outward tangent."""
    end_variance_px2: tuple[float, float]
    plausible: bool


def carried_innovation(
    correction: Correction,
    past: PastState,
    s_px: FloatArray,
    seen_ms: FloatArray,
    end_seen_ms: tuple[float, float],
    tips: tuple[bool, bool],
    fade_ms: float,
    bias_px: float,
) -> CarriedInnovation:
    """Compare ``correction`` with the state at its time, station by station, and carry it to now.

    s_px, seen_ms: (m,) material coordinates of the stations, and how long each has been measured by now; tips: whether
    either end is a free tip; bias_px: what all nodes of a correction may have in common (the homography's error), which
    no number of nodes averages away.
    """
    points = past.points
    length = float(arc_length(correction.nodes)[-1])
    dense = resample(correction.nodes, max(16, int(length / 3.0)))
    normals = left_normals(tangents(points))
    distance, at = project(points, dense)
    s_dense = np.linspace(0.0, length, len(dense))
    nearest = np.stack([np.interp(at, s_dense, dense[:, c]) for c in range(2)], axis=1)
    offset = ((nearest - points) * normals).sum(axis=1)
    lo, hi = past.ends_s_px
    inside = (at > 2.0) & (at < length - 2.0) & (s_px >= lo) & (s_px <= hi)
    # A foot point that is not on the normal belongs to another part of the DLO (a loop), or to none.
    inside &= np.abs(distance - np.abs(offset)) < 2.0 + 0.1 * np.abs(offset)
    node_s = np.linspace(0.0, length, len(correction.nodes))
    sigma = np.hypot(np.interp(at, node_s, correction.sigma_normal_px), bias_px)
    total = np.hypot(sigma, past.sigma_normal_px)
    plausible = bool(inside.sum() >= 3 and np.median(np.abs(offset[inside]) / total[inside]) < _GATE_SIGMA)
    share = np.maximum(np.exp(-np.maximum(seen_ms - past.seen_ms, 0.0) / fade_ms), _SMALLEST_SHARE)
    # Errors of neighbouring nodes are alike: a shape is worth one measurement per correlation length, not per node.
    redundancy = max(1.0, 120.0 / max(float(s_px[1] - s_px[0]), 1.0))
    variance = np.where(inside, redundancy * (sigma / share) ** 2, np.inf)
    shifts, variances = [], []
    for index in range(2):
        kind = correction.ends[index]
        if kind is not EndKind.TIP or not tips[index]:
            shifts.append(0.0)
            variances.append(np.inf)
            continue
        m_end = int(np.argmin(np.abs(s_px - past.ends_s_px[index])))
        tangent = tangents(points)[m_end] * (-1.0 if index == 0 else 1.0)
        residue = past.ends_s_px[index] - s_px[m_end]
        tip = points[m_end] + tangent * (residue * (-1.0 if index == 0 else 1.0))
        node = correction.nodes[0 if index == 0 else -1]
        left = max(float(np.exp(-max(end_seen_ms[index] - past.end_seen_ms[index], 0.0) / fade_ms)), _SMALLEST_SHARE)
        sigma_t = float(np.hypot(correction.sigma_tangent_px[0 if index == 0 else -1], bias_px))
        shifts.append(float((node - tip) @ tangent))
        variances.append((sigma_t / left) ** 2)
    return CarriedInnovation(offset, variance, (shifts[0], shifts[1]), (variances[0], variances[1]), plausible)


def oriented_like(correction: Correction, points: FloatArray) -> Correction:
    """The correction with its nodes in the order of ``points`` (m, 2): a segmenter may find the other end first."""
    nodes = resample(correction.nodes, len(points))
    if ((nodes - points) ** 2).sum() <= ((nodes[::-1] - points) ** 2).sum():
        return correction
    return Correction(
        seq=correction.seq,
        id=correction.id,
        t_us=correction.t_us,
        kind=correction.kind,
        nodes=correction.nodes[::-1],
        sigma_normal_px=correction.sigma_normal_px[::-1],
        sigma_tangent_px=correction.sigma_tangent_px[::-1],
        diameter_px=correction.diameter_px,
        ends=(correction.ends[1], correction.ends[0]),
        appearance=None,
        not_before_us=correction.not_before_us,
    )
