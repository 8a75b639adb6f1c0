"""Around the tracker: what waits, how much of it one publication takes, and what is counted. No I/O, no clock.

Overload is answered by less work: when batches wait, several of them share one publication (one update each all the
same, so that load never changes the trajectory), large ones among them are thinned, and when too many wait the oldest
are dropped; both are counted.

Considered and rejected: one long update for all that waits. A long step is predicted badly and searched widely, so that
it costs as much as the short ones that it replaces, and a replay no longer gives what the offline run gives.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace

from motiondlo.events.types import EventBatch
from motiondlo.rejects import RejectCounter
from motiondlo.tracking.backlog import MOST_MERGED, MOST_WAITING, Backlog
from motiondlo.tracking.types import Correction, EventTracker, TrackUpdate

LOSS_SHOWS_US = 30_000
MOST_EVENTS = 20_000
"""An update of so many takes 1 ms, half the time that a batch lasts."""


@dataclass(frozen=True)
class Step:
    """One update to publish, and what it rests on."""

    update: TrackUpdate
    t_ingest_ns: int
    """Host time at which the newest event used entered the system."""
    whole: bool
    """No batch is missing just before or in it, and all events of each were used."""


class EventTrackerCore:
    """Feeds an :class:`EventTracker`, one update at a time."""

    def __init__(
        self,
        tracker: EventTracker,
        patience: int,
        most: int = MOST_MERGED,
        most_waiting: int = MOST_WAITING,
        most_events: int = MOST_EVENTS,
    ) -> None:
        """``patience``: so many waiting batches are published one by one; ``most``: one publication takes no more.

        ``most_waiting``: beyond it the oldest are dropped, so that neither memory nor lag grows without bound.
        ``most_events``: a larger batch is thinned to about so many, evenly in time, while others wait behind it.
        """
        self._tracker = tracker
        self._most_events = most_events
        self._backlog = Backlog(patience, most, most_waiting)
        self.rejects = RejectCounter()
        self.counts: Counter[str] = Counter()
        self.tracks = 0
        self._t_us = self._missed_us = -1

    def on_correction(self, correction: Correction, sender: str = "") -> None:
        """Hand a correction over; a refusal is counted under its reason."""
        reason = self._tracker.correct(correction)
        if reason is None:
            self.counts["corrections"] += 1
        else:
            self.rejects.count(reason, sender)

    def push(self, batch: EventBatch, t_ingest_ns: int) -> None:
        """A batch has arrived, whose newest event entered the system at ``t_ingest_ns``."""
        self._backlog.push(batch, t_ingest_ns)

    @property
    def waiting(self) -> int:
        """Batches that wait for an update."""
        return len(self._backlog)

    @property
    def overloaded(self) -> bool:
        """Whether batches went missing within the last 30 ms of event time."""
        return self._missed_us >= 0 and 0 <= self._t_us - self._missed_us < LOSS_SHOWS_US

    def step(self) -> Step | None:
        """What is due of the waiting batches, for one publication; None when nothing waits."""
        taken = self._backlog.take()
        if not taken:
            return None
        batches = [item.batch for item in taken]
        if len(batches) > 1:
            batches = [self._thinned(batch) for batch in batches]
        thinned = any(len(mine.events) < len(item.batch.events) for mine, item in zip(batches, taken, strict=True))
        whole = not thinned and not any(batch.lost_before for batch in batches)
        self._t_us = taken[-1].batch.t1_us
        if not whole:
            self._missed_us = self._t_us
        return Step(self.on_batches(batches), taken[-1].t_ingest_ns, whole)

    def _thinned(self, batch: EventBatch) -> EventBatch:
        every = -(-len(batch.events) // self._most_events)
        if every <= 1:
            return batch
        events = batch.events[::every].copy()
        events.setflags(write=False)  # as what the bus delivers
        self.counts["thinned_events"] += len(batch.events) - len(events)
        return replace(batch, events=events)

    def on_batches(self, batches: Sequence[EventBatch]) -> TrackUpdate:
        """Update once for each of one or more consecutive batches; the last update."""
        for batch in batches:
            self.counts["updates"] += 1
            self.counts["events"] += len(batch.events)
            self.counts["lost_batches"] += batch.lost_before
            update = self._tracker.update(batch)
        self.counts["merged_batches"] += len(batches) - 1
        self.tracks = len(update.tracks)
        return update
