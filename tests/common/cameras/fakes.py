"""A clock that only moves when told, and a camera that comes and goes by it."""

from __future__ import annotations

from motiondlo.cameras.interface import Camera, CameraLost, EventChunk, FoundDevice


class Clock:
    """Host monotonic time."""

    def __init__(self, s: float = 100.0) -> None:
        self.s = s

    def ns(self) -> int:
        return round(self.s * 1e9)

    def sleep(self, seconds: float) -> None:
        self.s += seconds


class FakeCamera(Camera[EventChunk]):
    """Sends a byte every 10 ms while plugged in; waiting moves the clock."""

    name = "fake camera"

    def __init__(self, clock: Clock, unplugged: tuple[float, float] = (1e9, 1e9), silent_from: float = 1e9) -> None:
        self._clock, self._unplugged, self._silent_from = clock, unplugged, silent_from
        self._is_open = False
        self.opened_at: list[float] = []
        self.closed = 0

    def open(self) -> None:
        self.opened_at.append(self._clock.s)
        self._check()
        self._is_open = True

    def read(self, timeout_s: float) -> EventChunk | None:
        assert self._is_open
        self._check()
        if self._clock.s >= self._silent_from:
            self._clock.sleep(timeout_s)
            return None
        self._clock.sleep(0.01)
        return EventChunk(b"x", self._clock.ns())

    def close(self) -> None:
        self._is_open = False
        self.closed += 1

    def find(self) -> list[FoundDevice]:
        return []

    def _check(self) -> None:
        if self._unplugged[0] <= self._clock.s < self._unplugged[1]:
            raise CameraLost("unplugged")
