"""Cut a stream of events into batches on a fixed time grid."""

from __future__ import annotations

from collections.abc import Iterator

import numba
import numpy as np
import numpy.typing as npt

from motiondlo.events.joining import join
from motiondlo.events.types import EventArray, EventBatch, TriggerArray, empty_events, empty_triggers

FIRST_EVENT_LATE_US = 1_000_000
"""A stream whose first time lies later than this was cut out of a longer one: batches begin there, not at 0."""
MAX_SILENCE_US = 10_000_000
"""Silence up to this long is given as empty batches; a longer one is skipped, and told in ``lost_before``."""


@numba.njit(cache=True, nogil=True)
def first_at_or_after(times_us: npt.NDArray[np.int64], start: int, edge_us: int) -> int:
    """Index of the first of the sorted ``times_us[start:]`` that is not before ``edge_us``; near ones are found first.

    times_us: (N,) int64, may be strided.
    """
    n = len(times_us)
    step = 64
    low = start
    high = start
    while high < n and times_us[high] < edge_us:
        low = high + 1
        high += step
        step *= 2
    high = min(high, n)
    while low < high:
        middle = (low + high) // 2
        if times_us[middle] < edge_us:
            low = middle + 1
        else:
            high = middle
    return low


class BatchCutter:
    """Push decoded events, pull finished batches; used for files and for live streams alike.

    Batch edges are multiples of ``period_us``. The first batch is the grid cell of ``start_us``, or that of the first
    data if the stream begins more than FIRST_EVENT_LATE_US after it; earlier events are left out. Batches share memory
    with the arrays that were pushed.
    """

    def __init__(self, period_us: int = 1000, start_us: int = 0) -> None:
        if period_us <= 0:
            raise ValueError(f"period_us is {period_us}, must be positive")
        self.period_us = period_us
        self._start_us = start_us // period_us * period_us
        self._t0_us = self._start_us
        self._begun = self._given = False
        self._events: list[EventArray] = []
        self._triggers: list[TriggerArray] = []
        self._lost = 0

    def push(self, events: EventArray, triggers: TriggerArray, now_us: int) -> Iterator[EventBatch]:
        """Take events (N,) and triggers (K,) in time order, and give every batch that ends at or before ``now_us``.

        now_us: nothing earlier will come any more. The iterator must be used up before the next push.
        """
        if len(events):
            self._events.append(events)
        if len(triggers):
            self._triggers.append(triggers)
        return self._finished(now_us)

    def finish(self) -> Iterator[EventBatch]:
        """End of the stream: the batches up to and with the one that holds the last event or trigger."""
        last_us = max((int(parts[-1]["t"][-1]) for parts in (self._events, self._triggers) if parts), default=-1)
        return self._finished((last_us // self.period_us + 1) * self.period_us)

    def _finished(self, now_us: int) -> Iterator[EventBatch]:
        if not self._begin(now_us):
            return
        while self._t0_us + self.period_us <= now_us:
            self._skip_silence(now_us)
            t1_us = self._t0_us + self.period_us
            if t1_us > now_us:
                break
            events = _take_before(self._events, t1_us) if self._events else empty_events()
            triggers = _take_before(self._triggers, t1_us) if self._triggers else empty_triggers()
            batch = EventBatch(self._t0_us, t1_us, events, triggers, self._lost)
            self._lost, self._t0_us, self._given = 0, t1_us, True
            yield batch

    def _begin(self, now_us: int) -> bool:
        """Settle where the first batch starts, once the first time is known."""
        if not self._begun:
            first_us = self._next_us(now_us)
            if first_us < 0:
                return False
            if first_us > self._start_us + FIRST_EVENT_LATE_US:
                self._t0_us = first_us // self.period_us * self.period_us
            self._begun = True
        if not self._given:
            # The start may lie many pushes ahead.
            for parts in (self._events, self._triggers):
                if parts:
                    _take_before(parts, self._t0_us)
        return True

    def _next_us(self, now_us: int) -> int:
        return min((int(parts[0]["t"][0]) for parts in (self._events, self._triggers) if parts), default=now_us)

    def _skip_silence(self, now_us: int) -> None:
        if now_us - self._t0_us <= MAX_SILENCE_US:
            return
        silence_us = min(self._next_us(now_us), now_us) - self._t0_us
        if silence_us > MAX_SILENCE_US:
            cells = silence_us // self.period_us
            self._lost += cells
            self._t0_us += cells * self.period_us


def _take_before(parts: list[EventArray], edge_us: int) -> EventArray:
    """Take what lies before ``edge_us`` from the front of ``parts`` (not empty, nor is any of them) and return it."""
    taken = []
    while parts:
        first = parts[0]
        if first["t"][-1] < edge_us:
            taken.append(parts.pop(0))
            continue
        n = first_at_or_after(first["t"], 0, edge_us)
        if n == len(first):
            taken.append(parts.pop(0))
            continue
        taken.append(first[:n])
        parts[0] = first[n:]
        break
    return taken[0] if len(taken) == 1 else join(taken)
