"""The batches that wait for an update: how many share a publication, and which are dropped.

Overload is answered by less work: when batches wait, several of them share one publication, and when too many wait the
oldest are dropped and counted, so that neither memory nor lag grows without bound.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, replace

from motiondlo.events.types import EventBatch

PATIENCE, MOST_MERGED, MOST_WAITING = 2, 4, 12
"""What a cell does unless it is told otherwise; see :class:`Backlog`."""


@dataclass(frozen=True)
class Waiting:
    """A batch that waits for its update."""

    batch: EventBatch
    t_ingest_ns: int
    """Host time at which its newest event entered the system."""


class Backlog:
    """A bounded queue that keeps what is newest."""

    def __init__(self, patience: int = PATIENCE, most: int = MOST_MERGED, most_waiting: int = MOST_WAITING) -> None:
        """``patience``: so many waiting batches are published one by one; ``most``: one publication takes no more.

        ``most_waiting``: beyond it the oldest are dropped.
        """
        self._patience = patience
        self._most = most
        self._most_waiting = most_waiting
        self._waiting: deque[Waiting] = deque()
        self._lost = 0
        self.dropped_batches = 0
        self.dropped_events = 0

    def __len__(self) -> int:
        """Batches that wait."""
        return len(self._waiting)

    def push(self, batch: EventBatch, t_ingest_ns: int) -> None:
        """A batch has arrived, whose newest event entered the system at ``t_ingest_ns``."""
        self._waiting.append(Waiting(batch, t_ingest_ns))
        while len(self._waiting) > self._most_waiting:
            dropped = self._waiting.popleft().batch
            self._lost += 1 + dropped.lost_before
            self.dropped_batches += 1
            self.dropped_events += len(dropped.events)

    def take(self) -> list[Waiting]:
        """The batches that the next publication is for; empty when nothing waits.

        What was dropped before the first of them is added to its ``lost_before``.
        """
        count = min(len(self._waiting), self._most if len(self._waiting) > self._patience else 1)
        taken = [self._waiting.popleft() for _ in range(count)]
        if taken and self._lost:
            first = taken[0]
            taken[0] = replace(first, batch=replace(first.batch, lost_before=first.batch.lost_before + self._lost))
            self._lost = 0
        return taken
