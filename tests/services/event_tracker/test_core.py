"""Overload is answered by longer batches; nothing is dropped or reordered."""

from __future__ import annotations

import numpy as np

from motiondlo.events.types import EVENT_DTYPE, EventBatch, empty_events
from motiondlo.rejects import RejectReason
from motiondlo.tracking.types import Correction, CorrectionKind, TrackUpdate
from motiondlo_services.event_tracker.core import EventTrackerCore


class RecordingTracker:
    """Remembers what it was given."""

    def __init__(self) -> None:
        self.batches: list[EventBatch] = []

    def correct(self, correction: Correction) -> RejectReason | None:
        return RejectReason.TOO_OLD if correction.t_us < 0 else None

    def update(self, batch: EventBatch) -> TrackUpdate:
        self.batches.append(batch)
        return TrackUpdate(batch.t1_us, batch.t1_us, ())


def batches(count: int) -> list[EventBatch]:
    result = []
    for k in range(count):
        events = empty_events(2)
        events["t"] = (1000 * k + 1, 1000 * k + 900)
        result.append(EventBatch(1000 * k, 1000 * (k + 1), events, lost_before=1 if k == 1 else 0))
    return result


def correction(t_us: int) -> Correction:
    none = np.zeros(0)
    return Correction(1, 0, t_us, CorrectionKind.RETIRE, np.zeros((0, 2)), none, none)


def test_a_tracker_that_keeps_up_updates_once_a_batch() -> None:
    core = EventTrackerCore(RecordingTracker(), patience=3)
    assert [core.take(n) for n in (0, 1, 2, 3)] == [0, 1, 1, 1]


def test_BURST_is_taken_in_few_updates_in_order() -> None:
    tracker = RecordingTracker()
    core = EventTrackerCore(tracker, patience=3, most=4)
    waiting = batches(8)
    updates = []
    while waiting:
        count = core.take(len(waiting))
        updates.append(core.on_batches(waiting[:count]))
        waiting = waiting[count:]
    assert [update.t_us for update in updates] == [4000, 8000]
    assert [len(batch.events) for batch in tracker.batches] == [8, 8]
    assert all((np.diff(batch.events["t"]) > 0).all() for batch in tracker.batches)
    assert all(batch.events.dtype == EVENT_DTYPE for batch in tracker.batches), "kernels are compiled for this layout"
    assert [batch.lost_before for batch in tracker.batches] == [1, 0]
    assert core.counts["merged_batches"] == 6


def test_refused_corrections_are_counted_with_their_sender() -> None:
    core = EventTrackerCore(RecordingTracker(), patience=3)
    core.on_correction(correction(5), "fusion")
    core.on_correction(correction(-5), "fusion")
    assert core.counts["corrections"] == 1
    assert core.rejects.as_dict() == {"too_old": 1}
    assert core.rejects.senders() == {"fusion:too_old": 1}
