"""Around the decoder: batches out of raw bytes or of a replay, a bounded backlog, triggers, health. No I/O, no clock.

Overload is answered by dropping the oldest batches that wait: what is sent is the newest, and how much is missing in
front of it is in its ``lost_before``. Triggers are never dropped; they are handed out beside the batches.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable
from dataclasses import dataclass, replace

from motiondlo.events.clock import ClockEstimator
from motiondlo.events.cutter import BatchCutter
from motiondlo.events.joining import join
from motiondlo.events.stream_decoder import StreamDecoder
from motiondlo.events.trigger_monitor import TriggerMonitor
from motiondlo.events.types import EventBatch, TriggerArray, empty_triggers
from motiondlo.rejects import RejectReason

RATE_WINDOW_US = 1_000_000
MAX_BACKLOG_EVENTS = 4_000_000
"""64 MB: a burst of large batches is bounded by this, not by their number."""


def due_ns(t_us: int, start_us: int, start_ns: int, speed: float) -> int:
    """Host time at which replayed data of event time ``t_us`` are due, when ``start_us`` was due at ``start_ns``.

    speed: 1 real time, 2 twice as fast; 0 as fast as possible, everything is due at once.
    """
    if speed <= 0:
        return start_ns
    return start_ns + round((t_us - start_us) * 1000 / speed)


@dataclass(frozen=True)
class IngestedBatch:
    """A batch, and the host time at which the newest of its data entered the system."""

    batch: EventBatch
    t_ingest_ns: int


class EventIngestCore:
    """Takes raw bytes (``push``) or finished batches (``push_batches``), gives batches and triggers."""

    def __init__(self, decoder: StreamDecoder | None, batch_us: int = 1000, max_backlog: int = 50) -> None:
        """decoder: None when only batches will be pushed. max_backlog: batches that may wait to be taken."""
        self._decoder = decoder
        self._batch_us = batch_us
        self._shift_us: int | None = 0
        self._resume_us = -1
        self._outage_batches = 0
        self._cutter = BatchCutter(batch_us)
        self._max_backlog = max_backlog
        self._backlog: deque[IngestedBatch] = deque()
        self._backlog_events = 0
        self._lost_unsent = 0
        self._triggers: list[TriggerArray] = []
        self._recent: deque[tuple[int, int]] = deque()
        self._recent_events = 0
        self._last_drop_us = -1
        self.clock = ClockEstimator()
        self.trigger_monitor = TriggerMonitor()
        self.events = 0
        self.batches = 0
        self.lost = 0
        """Batches dropped here, and batches known to be missing in what came in."""
        self.t_us = -1
        """End of the newest batch."""
        self.epoch = 0
        """How often the camera's own clock started anew; event time goes on regardless."""

    def attach(self, decoder: StreamDecoder, host_ns: int, resume_us: int = -1) -> None:
        """The camera was opened (anew) at ``host_ns``: bytes from now on are its, and its clock has started anew.

        Event time goes on where the host's clock says that it is; ``resume_us``: where it is, when this ingest cannot
        know (it was started into a running cell), -1 otherwise. The batches of the outage count as lost.
        """
        self.finish(host_ns)
        if self._decoder is not None:
            self.epoch += 1
        self._decoder = decoder
        self._shift_us, self._resume_us = None, resume_us

    def push(self, raw: bytes, host_ns: int) -> None:
        """Take bytes as the camera sent them, which arrived at ``host_ns``. Raises RuntimeError without a decoder."""
        if self._decoder is None:
            raise RuntimeError("this ingest has no decoder")
        events, triggers = self._decoder.push(raw)
        now_us = self._decoder.time_us
        if now_us >= 0:
            if self._shift_us is None:
                self._go_on(now_us, host_ns)
            if self._shift_us:
                events["t"] += self._shift_us
                triggers["t"] += self._shift_us
                now_us += self._shift_us
            self.clock.update(now_us, host_ns)
        batches = self._cutter.push(events, triggers, now_us)
        if self._outage_batches and (first := next(batches, None)) is not None:
            lost, self._outage_batches = first.lost_before + self._outage_batches, 0
            self._take((replace(first, lost_before=lost),), host_ns)
        self._take(batches, host_ns)

    def push_batches(self, batches: Iterable[EventBatch], host_ns: int) -> None:
        """Take batches that were cut already (replay), entering at ``host_ns``."""
        for batch in batches:
            self.clock.update(batch.t1_us, host_ns)
            self._take((batch,), host_ns)

    def finish(self, host_ns: int) -> None:
        """End of the raw stream: what the decoder and the current batch still hold."""
        if self._decoder is not None:
            events, triggers = self._decoder.flush()
            shift_us = self._shift_us or 0
            events["t"] += shift_us
            triggers["t"] += shift_us
            self._take(self._cutter.push(events, triggers, self._decoder.time_us + shift_us), host_ns)
            self._take(self._cutter.finish(), host_ns)

    def pop(self) -> IngestedBatch | None:
        """The oldest batch that waits, or None; ``lost_before`` tells what was dropped in front of it."""
        if not self._backlog:
            return None
        item = self._backlog.popleft()
        self._backlog_events -= len(item.batch.events)
        if self._lost_unsent:
            item = replace(item, batch=replace(item.batch, lost_before=item.batch.lost_before + self._lost_unsent))
            self._lost_unsent = 0
        return item

    def take_triggers(self) -> TriggerArray:
        """(K,) triggers since the last call, also those of dropped batches."""
        taken = join(self._triggers) if self._triggers else empty_triggers()
        self._triggers.clear()
        return taken

    @property
    def backlog(self) -> int:
        """Batches that wait to be taken."""
        return len(self._backlog)

    @property
    def overloaded(self) -> bool:
        """Whether batches were dropped within the last 100 ms of event time."""
        return self._last_drop_us >= 0 and self.t_us - self._last_drop_us < 100_000

    @property
    def rejects(self) -> dict[str, int]:
        """Counts per reason, for health."""
        damage = self.damage
        counts = {
            RejectReason.BATCH_DROPPED.value: self.lost,
            RejectReason.OUT_OF_SENSOR.value: damage.get("out_of_sensor", 0),
            RejectReason.TIME_BACKWARDS.value: damage.get("time_backwards", 0),
        }
        return {reason: n for reason, n in counts.items() if n}

    def health(self) -> dict[str, object]:
        """Figures for health: rates over the last second of event time, totals, damage, backlog, clock."""
        return {
            "events_per_s": round(self._recent_events * 1e6 / RATE_WINDOW_US),
            "events": self.events,
            "batches": self.batches,
            "triggers": self.trigger_monitor.triggers,
            "triggers_missed": self.trigger_monitor.missed,
            "damage": self.damage,
            "clock_marks": {} if self._decoder is None else self._decoder.marks,
            "backlog": self.backlog,
            "lost_batches": self.lost,
            "overloaded": self.overloaded,
            "clock": self.clock.as_dict(),
        }

    def _go_on(self, device_us: int, host_ns: int) -> None:
        """Settle how far event time is ahead of the camera's clock, and where batches go on."""
        resume_us = self.clock.event_us(host_ns) if self.clock.ready else self._resume_us
        resume_us = max(resume_us, self.t_us)
        self._shift_us = 0
        if resume_us < 0:
            return
        first_us = -(-resume_us // self._batch_us) * self._batch_us
        self._shift_us = first_us - device_us
        self._cutter = BatchCutter(self._batch_us, first_us)
        if self.t_us >= 0:
            self._outage_batches = (first_us - self.t_us) // self._batch_us

    @property
    def damage(self) -> dict[str, int]:
        """Counts per kind of damage in the raw stream since the camera was opened."""
        return {} if self._decoder is None else self._decoder.damage

    def _take(self, batches: Iterable[EventBatch], host_ns: int) -> None:
        for batch in batches:
            n = len(batch.events)
            self.batches += 1
            self.events += n
            self.lost += batch.lost_before
            self.t_us = batch.t1_us
            if len(batch.triggers):
                self._triggers.append(batch.triggers)
                self.trigger_monitor.push(batch.triggers)
            self._count_rate(batch.t1_us, n)
            self._backlog.append(IngestedBatch(batch, host_ns))
            self._backlog_events += n
            self._drop_oldest()

    def _drop_oldest(self) -> None:
        while len(self._backlog) > 1 and (
            len(self._backlog) > self._max_backlog or self._backlog_events > MAX_BACKLOG_EVENTS
        ):
            dropped = self._backlog.popleft().batch
            self._backlog_events -= len(dropped.events)
            self._lost_unsent += 1 + dropped.lost_before
            self.lost += 1
            self._last_drop_us = self.t_us

    def _count_rate(self, t1_us: int, n: int) -> None:
        self._recent.append((t1_us, n))
        self._recent_events += n
        while self._recent[0][0] <= t1_us - RATE_WINDOW_US:
            self._recent_events -= self._recent.popleft()[1]
