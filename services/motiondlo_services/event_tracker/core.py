"""Around the tracker: what waits, how much of it one publication takes, and what is counted. No I/O, no clock.

Overload is answered by less work: when batches wait, several of them share one publication (one update each all the
same, so that load never changes the trajectory), and when too many wait the oldest are dropped and counted.

Considered and rejected: one long update for all that waits. A long step is predicted badly and searched widely, so that
it costs as much as the short ones that it replaces, and a replay no longer gives what the offline run gives.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

from motiondlo.events.types import EventBatch
from motiondlo.rejects import RejectCounter
from motiondlo.tracking.backlog import MOST_MERGED, MOST_WAITING, Backlog
from motiondlo.tracking.types import Correction, EventTracker, TrackUpdate


@dataclass(frozen=True)
class Step:
    """One update to publish, and what it rests on."""

    update: TrackUpdate
    t_ingest_ns: int
    """Host time at which the newest event used entered the system."""
    whole: bool
    """No batch is missing just before or in it."""


class EventTrackerCore:
    """Feeds an :class:`EventTracker`, one update at a time."""

    def __init__(
        self, tracker: EventTracker, patience: int, most: int = MOST_MERGED, most_waiting: int = MOST_WAITING
    ) -> None:
        """``patience``: so many waiting batches are published one by one; ``most``: one publication takes no more.

        ``most_waiting``: beyond it the oldest are dropped, so that neither memory nor lag grows without bound.
        """
        self._tracker = tracker
        self._backlog = Backlog(patience, most, most_waiting)
        self.rejects = RejectCounter()
        self.counts: Counter[str] = Counter()
        self.tracks = 0

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

    def step(self) -> Step | None:
        """What is due of the waiting batches, for one publication; None when nothing waits."""
        taken = self._backlog.take()
        if not taken:
            return None
        whole = not any(item.batch.lost_before for item in taken)
        return Step(self.on_batches([item.batch for item in taken]), taken[-1].t_ingest_ns, whole)

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
