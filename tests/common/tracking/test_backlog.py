from __future__ import annotations

from motiondlo.events.types import EventBatch, empty_events
from motiondlo.tracking.backlog import Backlog


def _batch(k, events=3):
    return EventBatch(k * 1000, (k + 1) * 1000, empty_events(events))


def _times(taken):
    return [waiting.batch.t0_us // 1000 for waiting in taken]


def test_one_by_one_until_patience_ends_then_several_at_once():
    backlog = Backlog(patience=2, most=3, most_waiting=10)
    for k in range(2):
        backlog.push(_batch(k), k)
    assert _times(backlog.take()) == [0]
    for k in range(2, 7):
        backlog.push(_batch(k), k)
    assert _times(backlog.take()) == [1, 2, 3]
    assert _times(backlog.take()) == [4, 5, 6]
    assert backlog.take() == []


def test_the_oldest_are_dropped_counted_and_told_to_the_next():
    backlog = Backlog(patience=1, most=2, most_waiting=3)
    for k in range(5):
        backlog.push(_batch(k), k)
    assert len(backlog) == 3
    assert (backlog.dropped_batches, backlog.dropped_events) == (2, 6)
    taken = backlog.take()
    assert _times(taken) == [2, 3]
    assert [waiting.batch.lost_before for waiting in taken] == [2, 0]
    assert backlog.take()[0].batch.lost_before == 0
