"""What a camera driver gives, and what it promises.

Freshness: ``read`` gives data in the order in which they were taken, each piece once; what was lost in front of a piece
is told with it. The time of arrival (host ``monotonic_ns``) is noted the moment the driver has the data, and is never
the time of the data: a frame's time is its trigger's, an event's is in its bytes.

A driver is opened and closed explicitly, never waits longer than it is told to, and raises :class:`CameraLost` as soon
as it knows that the device is gone. Reconnecting is not its business: see :mod:`motiondlo.cameras.link`.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import Generic, TypeVar

import numpy as np
import numpy.typing as npt

from motiondlo.errors import MotionDLOError

Image = npt.NDArray[np.uint8]
"""(H, W, 3) uint8, BGR."""

UNKNOWN = -1


class DriverMissing(MotionDLOError):
    """The driver's package is not installed; trying again will not help."""


class CameraLost(MotionDLOError):
    """The device was not found, was unplugged, or does not answer; it may come back."""


@dataclass(frozen=True)
class EventChunk:
    """Bytes as the event camera sent them (EVT3)."""

    raw: bytes
    arrived_ns: int
    """Host monotonic time at which the driver had them."""
    lost_packets: int = 0
    """Packets that were dropped in front of this one, as the driver knows them."""


@dataclass(frozen=True)
class Frame:
    """A frame as the camera sent it; its time is not known before it is paired with its trigger."""

    image: Image
    arrived_ns: int
    """Host monotonic time at which the driver had it."""
    counter: int = UNKNOWN
    """The camera's own number of the frame: counts up by one per exposure while the camera is open."""
    device_ns: int = UNKNOWN
    """The camera's own time of the exposure's start, ns from an origin that is fixed while the camera is open."""
    incomplete_before: int = 0
    """Frames in front of this one that arrived in part and were left out."""


Piece = TypeVar("Piece", bound=EventChunk | Frame)


@dataclass(frozen=True)
class FoundDevice:
    """A device that a driver can see."""

    name: str
    serial: str
    problem: str = ""
    """Why it cannot be used (permissions, in use); empty if it can."""


class Camera(ABC, Generic[Piece]):
    """One camera; ``Piece`` is what it sends. Used by one thread."""

    name: str
    """For people: which camera this is."""

    @abstractmethod
    def open(self) -> None:
        """Connect, configure, start. Raises CameraLost when there is no such device or it refuses its settings."""

    @abstractmethod
    def read(self, timeout_s: float) -> Piece | None:
        """The next piece, or None when none comes within ``timeout_s``. Raises CameraLost when the device is gone."""

    @abstractmethod
    def close(self) -> None:
        """Stop and release the device; harmless when it is not open or gone. Never raises."""

    @abstractmethod
    def find(self) -> list[FoundDevice]:
        """The devices that could be opened now. Raises CameraLost when that cannot be found out."""


EventCamera = Camera[EventChunk]
FrameCamera = Camera[Frame]
