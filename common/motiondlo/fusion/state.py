"""The fused state of the scene, as the state message carries it."""

from __future__ import annotations

from dataclasses import dataclass, replace
from enum import StrEnum

import numpy as np
import numpy.typing as npt

from motiondlo.geometry.curve import arc_length, left_normals, tangents
from motiondlo.tracking.types import TrackState

FloatArray = npt.NDArray[np.float64]

_HALF_BELIEVED_US = 1_000_000
"""Without events a place is believed half as much after so long: whatever holds a DLO may move it meanwhile."""


class Mode(StrEnum):
    """What the scene, or the cell, is doing."""

    BOOT = "BOOT"
    """No DLO is known yet."""
    STATIC = "STATIC"
    MOTION = "MOTION"
    DEGRADED = "DEGRADED"
    """The state goes on, but something that it rests on is missing or failing."""


@dataclass(frozen=True)
class FusedDlo:
    """One DLO of the fused state."""

    id: int
    nodes: FloatArray
    """(M, 2) event px, equidistant."""
    sigma_px: FloatArray
    """(M,) standard deviation normal to the curve."""
    velocity_px_s: FloatArray
    """(M, 2)."""
    visible: npt.NDArray[np.uint8]
    """(M,)."""
    diameter_px: float
    length_px: float
    confidence: float
    moving: bool
    source: str
    t_corrected_us: int
    sigma_tangent_px: FloatArray | None = None
    """(M,) standard deviation along the curve; None where nobody said."""


@dataclass(frozen=True)
class FusedState:
    """Everything known at ``t_us``."""

    t_us: int
    t_events_us: int
    mode: Mode
    dlos: tuple[FusedDlo, ...]


@dataclass(frozen=True)
class FrameRequest:
    """Fusion wants one frame segmented: the newest one taken at or after ``after_us`` (-1: any)."""

    reason: str
    after_us: int
    ids: frozenset[int] = frozenset()
    """The DLOs that it is for; empty: the whole scene."""
    number: int = 0
    """Counts up with every request sent; an answer names it."""


def fused_dlo(track: TrackState) -> FusedDlo:
    """The public view of a track: the covariance reduced to the standard deviations across and along the curve."""
    along = tangents(track.nodes)
    normals = left_normals(along)
    xx, xy, yy = track.cov_px2.T
    variance = normals[:, 0] ** 2 * xx + 2 * normals[:, 0] * normals[:, 1] * xy + normals[:, 1] ** 2 * yy
    variance_along = along[:, 0] ** 2 * xx + 2 * along[:, 0] * along[:, 1] * xy + along[:, 1] ** 2 * yy
    return FusedDlo(
        id=track.id,
        nodes=track.nodes,
        sigma_px=np.sqrt(np.maximum(variance, 0.0)),
        velocity_px_s=track.velocity_px_s,
        visible=track.visible,
        diameter_px=track.diameter_px,
        length_px=float(arc_length(track.nodes)[-1]),
        confidence=track.confidence,
        moving=track.moving,
        source=track.source.value,
        t_corrected_us=track.t_corrected_us,
        sigma_tangent_px=np.sqrt(np.maximum(variance_along, 0.0)),
    )


def unsupported(state: FusedState, silent_us: int) -> FusedState:
    """``state``, of which nothing was seen any more for ``silent_us``: for the same time, and no longer believed."""
    left = 0.5 ** (silent_us / _HALF_BELIEVED_US)
    dlos = tuple(
        replace(dlo, source="predicted", visible=np.zeros_like(dlo.visible), confidence=dlo.confidence * left)
        for dlo in state.dlos
    )
    return replace(state, mode=Mode.BOOT if state.mode is Mode.BOOT else Mode.DEGRADED, dlos=dlos)
