"""Around the tracker: how much waiting work one update takes, and what is counted. No I/O, no clock.

Overload is answered by less work, never by lag: when batches wait, one update takes several of them (longer batches,
fewer updates); every batch is still used. Not all of them at once: a long step is predicted badly and searched widely,
so that it costs more than the short ones that it replaces, and the next ones wait even longer.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence

from motiondlo.events.joining import join
from motiondlo.events.types import EventBatch
from motiondlo.rejects import RejectCounter
from motiondlo.tracking.types import Correction, EventTracker, TrackUpdate


class EventTrackerCore:
    """Feeds an :class:`EventTracker`, one update at a time."""

    def __init__(self, tracker: EventTracker, patience: int, most: int = 4) -> None:
        """``patience``: so many waiting batches are still taken one by one; ``most``: one update takes no more."""
        self._tracker = tracker
        self._patience = patience
        self._most = most
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

    def take(self, waiting: int) -> int:
        """How many of the ``waiting`` batches the next update should take."""
        return min(waiting, self._most if waiting > self._patience else 1)

    def on_batches(self, batches: Sequence[EventBatch]) -> TrackUpdate:
        """One update for one or more consecutive batches (at least one)."""
        batch = batches[0] if len(batches) == 1 else merged(batches)
        self.counts["updates"] += 1
        self.counts["events"] += len(batch.events)
        self.counts["merged_batches"] += len(batches) - 1
        self.counts["lost_batches"] += batch.lost_before
        update = self._tracker.update(batch)
        self.tracks = len(update.tracks)
        return update


def merged(batches: Sequence[EventBatch]) -> EventBatch:
    """Consecutive batches as one."""
    return EventBatch(
        t0_us=batches[0].t0_us,
        t1_us=batches[-1].t1_us,
        events=join([batch.events for batch in batches]),
        triggers=join([batch.triggers for batch in batches]),
        lost_before=sum(batch.lost_before for batch in batches),
    )
