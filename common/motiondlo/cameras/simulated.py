"""What simulated cameras have in common: one scene that goes round and round with the host's clock, and unplugging.

The scene's time is the host's monotonic time modulo the length of the recording, so that two cameras in two processes
see the same, whenever each was opened. Where a round ends the scene jumps back to its beginning.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from motiondlo.cameras.config import Span
from motiondlo.cameras.interface import CameraLost
from motiondlo.errors import RecordingError
from motiondlo.recording.layout import Recording, open_recording

REST_US = 100_000
"""Between the last frame of a round and the first of the next, at least."""


class Scene:
    """A recording as something that goes on all the time. Scene time: us of the recording; host time: monotonic ns."""

    def __init__(self, recording: Path, slow_motion: float) -> None:
        """Raises RecordingError, also for a recording without frames: their triggers say how long a round is."""
        self.recording: Recording = open_recording(recording)
        if not self.recording.frames:
            raise RecordingError(f"{recording}: has no frames.", "Simulated cameras need a recording with frames.")
        self.slow_motion = slow_motion
        exposures_us = [entry.t_us for entry in self.recording.frames]
        self.exposures_us = tuple(round(t_us * slow_motion) for t_us in exposures_us)
        """Start of each exposure, us from the start of the round."""
        last_us = max(exposures_us) + REST_US
        self.round_us = round(last_us * slow_motion)
        """Length of a round, host time."""

    def round_of(self, host_ns: int) -> tuple[int, int]:
        """The round under way at ``host_ns``, and the time since its start, us."""
        return divmod(host_ns // 1000, self.round_us)


class Plug:
    """Whether the cable is in, by the seconds since the camera was first opened."""

    def __init__(self, unplugged_s: tuple[Span, ...], now_ns: Callable[[], int]) -> None:
        self._unplugged_s = unplugged_s
        self._now_ns = now_ns
        self._first_ns: int | None = None

    def check(self) -> None:
        """Raises CameraLost while the cable is out."""
        if self._first_ns is None:
            self._first_ns = self._now_ns()
        since_s = (self._now_ns() - self._first_ns) * 1e-9
        if any(start <= since_s < end for start, end in self._unplugged_s):
            raise CameraLost("unplugged")
