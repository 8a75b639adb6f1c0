"""Where a moving DLO has come to while nobody tracked it: constant velocity for a moment, and what that is worth."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import numpy.typing as npt

from motiondlo.tracking.types import Correction, TrackSource, TrackState

FloatArray = npt.NDArray[np.float64]

MOTION_KNOWN_US = 100_000
"""How long a last known velocity says anything."""
ACCELERATION_SIGMA_PX_S2 = 20_000.0
"""Of a DLO in a robot's hand (4 m/s2 at 5 px/mm)."""


def _ahead(elapsed_us: int) -> tuple[float, float]:
    """Seconds to go ahead, and the standard deviation, px, of the place after them."""
    ahead_s = min(max(elapsed_us, 0), MOTION_KNOWN_US) * 1e-6
    return ahead_s, 0.5 * ACCELERATION_SIGMA_PX_S2 * ahead_s**2


def carried_state(state: TrackState, elapsed_us: int) -> TrackState:
    """``state``, ``elapsed_us`` later, as a prediction; one that rested still rests."""
    if not state.moving:
        return replace(state, source=TrackSource.PREDICTED)
    ahead_s, grown_px = _ahead(elapsed_us)
    return replace(
        state,
        nodes=state.nodes + ahead_s * state.velocity_px_s,
        cov_px2=state.cov_px2 + np.array([grown_px**2, 0.0, grown_px**2]),
        source=TrackSource.PREDICTED,
    )


def carried_correction(correction: Correction, now_us: int) -> Correction:
    """A shape with a velocity, at ``now_us``; the velocity is dropped when it is too old to say anything."""
    if correction.velocity_px_s is None:
        return correction
    elapsed_us = now_us - correction.t_us
    ahead_s, grown_px = _ahead(elapsed_us)
    return replace(
        correction,
        nodes=correction.nodes + ahead_s * correction.velocity_px_s,
        sigma_normal_px=np.hypot(correction.sigma_normal_px, grown_px),
        sigma_tangent_px=np.hypot(correction.sigma_tangent_px, grown_px),
        velocity_px_s=correction.velocity_px_s if elapsed_us < MOTION_KNOWN_US else None,
    )
