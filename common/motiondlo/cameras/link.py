"""Keeps a camera connected: opens it, notices when it is gone or silent, opens it again with back-off."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Generic

from motiondlo.cameras.interface import Camera, CameraLost, Piece

BACKOFF_FIRST_S = 0.2
BACKOFF_MAX_S = 2.0


@dataclass(frozen=True)
class LinkReport:
    """How the connection is, for health."""

    connected: bool
    problem: str
    """What is wrong now; empty while the camera is there."""
    outages: int
    """How often it was lost, or not there at the start."""
    connections: int
    """How often it was opened."""


class CameraLink(Generic[Piece]):
    """A camera that may come and go. ``read`` never raises for a camera that is gone: it reports, and tries again."""

    def __init__(self, camera: Camera[Piece], stall_s: float, now_ns: Callable[[], int]) -> None:
        """stall_s: silence after which the camera counts as lost, 0 never. now_ns: the host's monotonic clock."""
        self._camera = camera
        self._stall_ns = int(stall_s * 1e9)
        self._now_ns = now_ns
        self._open = False
        self._problem = f"{camera.name} is not open yet"
        self._try_at_ns = 0
        self._backoff_s = BACKOFF_FIRST_S
        self._heard_ns = 0
        self._outages = 0
        self._connections = 0

    @property
    def report(self) -> LinkReport:
        """May be read by another thread than the one that reads the camera."""
        return LinkReport(self._open, self._problem, self._outages, self._connections)

    @property
    def pause_s(self) -> float:
        """How long there is nothing to do: until the next attempt, 0 while the camera is open."""
        return 0.0 if self._open else max(0.0, (self._try_at_ns - self._now_ns()) * 1e-9)

    def read(self, timeout_s: float) -> Piece | None:
        """The next piece, or None: nothing within ``timeout_s``, or not connected (then at once, see ``pause_s``)."""
        try:
            if not self._open and not self._connect():
                return None
            piece = self._camera.read(timeout_s)
        except CameraLost as lost:
            self._lose(f"{self._camera.name}: {lost.what}")
            return None
        now_ns = self._now_ns()
        if piece is not None:
            self._heard_ns = now_ns
            self._backoff_s = BACKOFF_FIRST_S  # only data prove that it works
        elif self._stall_ns and now_ns - self._heard_ns >= self._stall_ns:
            self._lose(f"{self._camera.name}: silent for {(now_ns - self._heard_ns) * 1e-9:.1f} s")
        return piece

    def close(self) -> None:
        """Close the camera."""
        self._open = False
        self._camera.close()

    def _connect(self) -> bool:
        if self._now_ns() < self._try_at_ns:
            return False
        self._camera.open()
        self._open = True
        self._problem = ""
        self._connections += 1
        self._heard_ns = self._now_ns()
        return True

    def _lose(self, problem: str) -> None:
        if self._open or not self._outages:
            self._outages += 1
        self._open = False
        self._problem = problem
        self._camera.close()
        self._try_at_ns = self._now_ns() + int(self._backoff_s * 1e9)
        self._backoff_s = min(2 * self._backoff_s, BACKOFF_MAX_S)
