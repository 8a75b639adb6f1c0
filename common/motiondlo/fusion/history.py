"""A short, thinned memory of past track updates, so that a late segmentation meets the tracks of its own time."""

from __future__ import annotations

from bisect import bisect_left
from collections import deque

from motiondlo.tracking.types import TrackState


class TrackHistory:
    """Tracks by time, at least ``step_us`` apart, for the last ``span_us``; bounded memory."""

    def __init__(self, span_us: int, step_us: int) -> None:
        self._step_us = step_us
        self._entries: deque[tuple[int, tuple[TrackState, ...]]] = deque(maxlen=max(2, span_us // step_us + 1))

    def add(self, t_us: int, tracks: tuple[TrackState, ...]) -> None:
        """Remember the tracks at ``t_us`` unless the previous entry is too near; a step back in time clears all."""
        if self._entries and t_us < self._entries[-1][0]:
            self._entries.clear()
        if not self._entries or t_us - self._entries[-1][0] >= self._step_us:
            self._entries.append((t_us, tracks))

    def at(self, t_us: int) -> tuple[TrackState, ...] | None:
        """The tracks nearest to ``t_us``; None when it lies before what is remembered, or nothing is."""
        if not self._entries or t_us < self._entries[0][0] - self._step_us:
            return None
        times = [entry[0] for entry in self._entries]
        k = min(bisect_left(times, t_us), len(times) - 1)
        if k > 0 and t_us - times[k - 1] <= times[k] - t_us:
            k -= 1
        return self._entries[k][1]
