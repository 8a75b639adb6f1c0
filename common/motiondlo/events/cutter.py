"""Cut a stream of events into batches on a fixed time grid."""

from __future__ import annotations

from collections.abc import Iterator

import numba
import numpy as np
import numpy.typing as npt

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
        self._begun = False
        self._events = empty_events()
        self._triggers = empty_triggers()
        self._lost = 0

    @property
    def pending(self) -> int:
        """Events that wait for their batch to finish."""
        return len(self._events)

    def push(self, events: EventArray, triggers: TriggerArray, now_us: int) -> Iterator[EventBatch]:
        """Take events (N,) and triggers (K,) in time order, and give every batch that ends at or before ``now_us``.

        now_us: nothing earlier will come any more. The iterator must be used up before the next push.
        """
        self._events = np.concatenate([self._events, events]) if len(self._events) else events
        self._triggers = np.concatenate([self._triggers, triggers]) if len(self._triggers) else triggers
        return self._finished(now_us)

    def finish(self) -> Iterator[EventBatch]:
        """End of the stream: the batches up to and with the one that holds the last event or trigger."""
        last_us = max(
            (int(part["t"][-1]) for part in (self._events, self._triggers) if len(part)), default=self._t0_us - 1
        )
        return self._finished((last_us // self.period_us + 1) * self.period_us)

    def _finished(self, now_us: int) -> Iterator[EventBatch]:
        if not self._begin(now_us):
            return
        events, triggers = self._events, self._triggers
        event_times, trigger_times = events["t"], triggers["t"]
        i = first_at_or_after(event_times, 0, self._t0_us)
        k = first_at_or_after(trigger_times, 0, self._t0_us)
        while self._t0_us + self.period_us <= now_us:
            self._skip_silence(event_times, i, trigger_times, k, now_us)
            t1_us = self._t0_us + self.period_us
            if t1_us > now_us:
                break
            i_end = first_at_or_after(event_times, i, t1_us)
            k_end = first_at_or_after(trigger_times, k, t1_us) if k < len(triggers) else k
            batch = EventBatch(self._t0_us, t1_us, events[i:i_end], triggers[k:k_end], self._lost)
            i, k, self._lost, self._t0_us = i_end, k_end, 0, t1_us
            yield batch
        # A copy, so that a few waiting events do not keep a large buffer alive.
        self._events = events[i:].copy()
        self._triggers = triggers[k:].copy()

    def _begin(self, now_us: int) -> bool:
        """Settle where the first batch starts, once the first time is known."""
        if not self._begun:
            first_us = min((int(part["t"][0]) for part in (self._events, self._triggers) if len(part)), default=now_us)
            if first_us < 0:
                return False
            if first_us > self._start_us + FIRST_EVENT_LATE_US:
                self._t0_us = first_us // self.period_us * self.period_us
            self._begun = True
        return True

    def _skip_silence(
        self,
        event_times: npt.NDArray[np.int64],
        i: int,
        trigger_times: npt.NDArray[np.int64],
        k: int,
        now_us: int,
    ) -> None:
        if now_us - self._t0_us <= MAX_SILENCE_US:
            return
        next_us = now_us
        if i < len(event_times):
            next_us = min(next_us, int(event_times[i]))
        if k < len(trigger_times):
            next_us = min(next_us, int(trigger_times[k]))
        if next_us - self._t0_us > MAX_SILENCE_US:
            cells = (next_us - self._t0_us) // self.period_us
            self._lost += cells
            self._t0_us += cells * self.period_us
