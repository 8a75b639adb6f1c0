"""Absorbing a late frame shape (paper, "Overall Pipeline").

"... the frame worker posts confidence- and timestamp-weighted correction signals that the event loop integrates into
the tracker state." The weight is ours: the track's variance over the sum of both (confidence), decaying with the time
that the DLO has moved since the frame (time stamp; a DLO at rest since then takes the shape at full weight).
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from motiondlo.geometry.curve import arc_length, project, resample
from motiondlo.tracking.paper.params import PaperParams
from motiondlo.tracking.paper.track import PastState

FloatArray = npt.NDArray[np.float64]

# A shape shorter than this share of the track shows only a part of it, and tells nothing about places along it.
_WHOLE_SHARE = 0.8


def innovation(
    past: PastState, nodes: FloatArray, sigma_normal_px: FloatArray, moved_us: int, params: PaperParams
) -> FloatArray:
    """Displacement of the track's nodes that a frame's shape asks for, weighted; to be added to every state since then.

    past: the state at the frame's time. nodes: (K, 2) event px of the shape, either direction. sigma_normal_px: (K,).
    moved_us: how long the DLO has been moving by now, in all. Returns (M, 2): nodes are equidistant, so that index m is
    the same material point (relative arc length) at the frame's time and now.
    """
    shape, sigma = _same_direction(past.nodes, nodes, sigma_normal_px)
    m = len(past.nodes)
    length, length_past = float(arc_length(shape)[-1]), float(arc_length(past.nodes)[-1])
    if length >= _WHOLE_SHARE * length_past:
        target = resample(shape, m)
        sigma2 = np.interp(np.linspace(0.0, 1.0, m), np.linspace(0.0, 1.0, len(sigma)), sigma) ** 2
        known = np.ones(m, np.bool_)
    else:
        _, s = project(past.nodes, shape)
        knots = arc_length(shape)
        target = np.stack([np.interp(s, knots, shape[:, 0]), np.interp(s, knots, shape[:, 1])], axis=1)
        sigma2 = np.interp(s, knots, sigma) ** 2
        known = (s > 0.0) & (s < knots[-1])
    confidence = past.variance_px2 / (past.variance_px2 + sigma2)
    age = float(np.exp(-max(moved_us - past.moved_us, 0) / params.blend_decay_us))
    return np.asarray(np.where(known, confidence * age, 0.0)[:, None] * (target - past.nodes), dtype=np.float64)


def _same_direction(reference: FloatArray, shape: FloatArray, sigma: FloatArray) -> tuple[FloatArray, FloatArray]:
    """The shape in the direction of the reference."""
    return (shape[::-1], sigma[::-1]) if runs_backwards(reference, shape) else (shape, sigma)


def runs_backwards(reference: FloatArray, shape: FloatArray) -> bool:
    """Whether a polyline passes a reference curve from its end to its start; (M, 2), (K, 2)."""
    count = 16
    a, b = resample(reference, count), resample(shape, count)
    straight = np.hypot(*(a - b).T).sum()
    return bool(np.hypot(*(a - b[::-1]).T).sum() < straight)
