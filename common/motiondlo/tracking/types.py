"""What a tracker takes and gives: corrections in, track updates out."""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import StrEnum
from typing import Protocol

import numpy as np
import numpy.typing as npt

from motiondlo.events.types import EventBatch
from motiondlo.frames.types import Appearance, EndKind
from motiondlo.rejects import RejectReason

FloatArray = npt.NDArray[np.float64]


class CorrectionKind(StrEnum):
    """What fusion wants done with a shape from the frame branch."""

    REINITIALISE = "reinitialise"
    """Start the track, or start it anew: the shape replaces everything."""
    BLEND = "blend"
    """An innovation at ``t_us``, carried forward along the material coordinate to now."""
    RETIRE = "retire"
    """End the track; nodes are ignored."""


@dataclass(frozen=True)
class Correction:
    """A shape from the frame branch at its frame's trigger time (the late-correction rule)."""

    seq: int
    """Increases by one per correction of a fusion process; repeats and reordering are refused by it."""
    id: int
    t_us: int
    kind: CorrectionKind
    nodes: FloatArray
    """(M, 2) event px, equidistant; (0, 2) for RETIRE."""
    sigma_normal_px: FloatArray
    """(M,) event px."""
    sigma_tangent_px: FloatArray
    """(M,) event px."""
    diameter_px: float = 0.0
    ends: tuple[EndKind, EndKind] = (EndKind.UNKNOWN, EndKind.UNKNOWN)
    appearance: Appearance | None = None
    not_before_us: int = -1
    """Apply at the first update at or after this event time (replay emulates the segmenter's latency); -1: at once."""
    velocity_px_s: FloatArray | None = None
    """(M, 2) at ``t_us``, for REINITIALISE: a restarted tracker's DLOs are given back as they moved; None: unknown."""


class TrackSource(StrEnum):
    """What the newest estimate of a DLO rests on."""

    EVENT = "event"
    FRAME = "frame"
    PREDICTED = "predicted"


@dataclass(frozen=True)
class TrackState:
    """One DLO at one time."""

    id: int
    nodes: FloatArray
    """(M, 2) event px, equidistant from end to end of what is believed to exist (also outside the image or hidden)."""
    velocity_px_s: FloatArray
    """(M, 2)."""
    cov_px2: FloatArray
    """(M, 3) position covariance per node: xx, xy, yy."""
    visible: npt.NDArray[np.uint8]
    """(M,) 1 where the node was supported by data lately."""
    diameter_px: float
    confidence: float
    """0..1."""
    moving: bool
    source: TrackSource
    t_corrected_us: int
    """Time of the last frame shape absorbed, -1 for none."""
    fit_px: float = 0.0
    """Root mean square of the innovations of the last update, along the normal; 0 without observations."""
    reinitialised: int = 0
    """How often the track was started anew."""


@dataclass(frozen=True)
class TrackUpdate:
    """The outcome of one event batch: every DLO at ``t_us``."""

    t_us: int
    t_events_us: int
    """Time of the newest event used, -1 before the first."""
    tracks: tuple[TrackState, ...]
    active_ratio: float = 0.0
    """Share of sensor pixels that the moving DLOs' events cover (the paper's hibernation ratio rho)."""
    events: int = 0
    """Events in the batch."""
    stages_ns: dict[str, int] = field(default_factory=dict)
    """Host time per stage of this update, when asked for."""
    rejects: dict[str, int] = field(default_factory=dict)
    """Corrections refused since the start, per reason."""
    disturbed: str = ""
    """Why the events of the batch are not to be believed, so that all is prediction; empty when they are."""


class EventTracker(Protocol):
    """A tracker of any number of DLOs; deterministic: the same batches and corrections give the same updates."""

    def correct(self, correction: Correction) -> RejectReason | None:
        """Take a correction (kept until ``not_before_us`` if that lies ahead); a reason if it is refused."""
        ...

    def update(self, batch: EventBatch) -> TrackUpdate:
        """Advance to ``batch.t1_us``. A gap before the batch is bridged by prediction."""
        ...
