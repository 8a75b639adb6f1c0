"""The one event dtype of the code base, triggers, and the batch in which both travel."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt

# 16 bytes an event; the time is the event camera's own, in microseconds from the start of the recording or camera.
EVENT_DTYPE = np.dtype(
    {"names": ["t", "x", "y", "p"], "formats": ["<i8", "<u2", "<u2", "u1"], "offsets": [0, 8, 10, 12], "itemsize": 16}
)
# edge: 1 rising (exposure of a frame starts), 0 falling (it ends).
TRIGGER_DTYPE = np.dtype(
    {"names": ["t", "channel", "edge"], "formats": ["<i8", "u1", "u1"], "offsets": [0, 8, 9], "itemsize": 16}
)

EventArray = npt.NDArray[Any]
"""(N,) array of :data:`EVENT_DTYPE`."""
TriggerArray = npt.NDArray[Any]
"""(K,) array of :data:`TRIGGER_DTYPE`."""


def empty_events(n: int = 0) -> EventArray:
    """(n,) zeroed events."""
    return np.zeros(n, EVENT_DTYPE)


def empty_triggers(n: int = 0) -> TriggerArray:
    """(n,) zeroed triggers."""
    return np.zeros(n, TRIGGER_DTYPE)


@dataclass(frozen=True)
class SensorGeometry:
    """Size of the event sensor in pixels."""

    width_px: int = 1280
    height_px: int = 720


@dataclass(frozen=True)
class EventBatch:
    """All events with ``t0_us <= t < t1_us``, in time order; an empty batch is sent too (silence is a measurement).

    ``t1_us`` lies on a fixed grid (multiples of the batch period), so that a recording is cut alike offline and live.
    """

    t0_us: int
    t1_us: int
    events: EventArray
    """(N,) :data:`EVENT_DTYPE`."""
    triggers: TriggerArray = field(default_factory=empty_triggers)
    """(K,) :data:`TRIGGER_DTYPE`."""
    lost_before: int = 0
    """Batches that are known to be missing between the previous batch and this one."""
