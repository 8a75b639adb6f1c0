"""The paper's fusion, for comparison: confidence- and timestamp-weighted blending (paper, "Fusion Mechanism").

The paper gives no formula. Here the shape's weight is its score's share of both confidences, and falls exponentially
with its age; the tracker is started anew from the blended nodes, moved on by what the track has moved since.
"""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from motiondlo.geometry.curve import resample
from motiondlo.tracking.types import TrackState

FloatArray = npt.NDArray[np.float64]


def blend_weight(score: float, confidence: float, age_us: int, memory_ms: float) -> float:
    """Weight 0..1 of a shape of ``score`` against a track of ``confidence``, ``age_us`` after its frame."""
    total = score + confidence
    share = score / total if total > 0.0 else 0.5
    return share * math.exp(-max(age_us, 0) / (1000.0 * memory_ms))


def blended(shape: FloatArray, then: TrackState, now: TrackState, weight: float) -> FloatArray:
    """The track now (M, 2), moved by ``weight`` of what the shape (N, 2), in its direction, was off at its time."""
    return now.nodes + weight * (resample(shape, len(then.nodes)) - then.nodes)
