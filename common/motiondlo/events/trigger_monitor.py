"""Missing external triggers: gaps in the pattern of a periodic trigger line."""

from __future__ import annotations

from collections import deque
from statistics import median

from motiondlo.events.types import TriggerArray

RISING = 1
_LEARNED_FROM = 3
_REMEMBERED = 15


class TriggerMonitor:
    """Watches one channel; its period is learned as the median of the latest intervals between rising edges."""

    def __init__(self, channel: int = 0) -> None:
        self.channel = channel
        self.triggers = 0
        """Edges of the channel so far."""
        self.missed = 0
        """Rising edges that should have come in between, and edges that never came between two of the same kind."""
        self.gaps: list[tuple[int, int]] = []
        """The latest gaps as (t_us before, t_us after), 100 at most."""
        self._last_rising_us = -1
        self._last_edge = -1
        self._intervals_us: deque[int] = deque(maxlen=_REMEMBERED)

    @property
    def period_us(self) -> int:
        """Distance of rising edges, 0 before it is known."""
        return round(median(self._intervals_us)) if len(self._intervals_us) >= _LEARNED_FROM else 0

    def push(self, triggers: TriggerArray) -> int:
        """Take triggers (K,) in time order; returns how many were found missing just now."""
        missed = 0
        for t_us, channel, edge in triggers[["t", "channel", "edge"]].tolist():
            if channel == self.channel:
                self.triggers += 1
                missed += self._on_rising(t_us) if edge == RISING else int(self._last_edge not in (RISING, -1))
                self._last_edge = edge
        self.missed += missed
        return missed

    def _on_rising(self, t_us: int) -> int:
        missed = int(self._last_edge == RISING)
        period_us = self.period_us
        if self._last_rising_us >= 0:
            interval_us = t_us - self._last_rising_us
            if period_us and interval_us > 1.5 * period_us:
                # a lost pair of edges counts as the frame that it would have been: once
                missed += round(interval_us / period_us) - 1
                self.gaps = [*self.gaps[-99:], (self._last_rising_us, t_us)]
            else:
                self._intervals_us.append(interval_us)
        self._last_rising_us = t_us
        return missed
