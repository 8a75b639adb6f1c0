"""Overload is answered by longer batches; nothing is dropped or reordered."""

from __future__ import annotations

import numpy as np

from motiondlo.events.types import EventBatch, empty_events
from motiondlo.rejects import RejectReason
from motiondlo.tracking.types import Correction, CorrectionKind, TrackUpdate
from motiondlo_services.event_tracker.core import EventTrackerCore, Step


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


def run_dry(core: EventTrackerCore) -> list[Step]:
    steps = []
    while (step := core.step()) is not None:
        steps.append(step)
    return steps


def test_a_tracker_that_keeps_up_updates_once_a_batch() -> None:
    core = EventTrackerCore(RecordingTracker(), patience=3)
    assert core.step() is None
    for k, batch in enumerate(batches(3)):
        core.push(batch, t_ingest_ns=10 * k)
    assert [(step.update.t_us, step.t_ingest_ns) for step in run_dry(core)] == [(1000, 0), (2000, 10), (3000, 20)]


def test_BURST_is_published_less_often_but_tracked_all_the_same() -> None:
    tracker = RecordingTracker()
    core = EventTrackerCore(tracker, patience=3, most=4)
    for k, batch in enumerate(batches(8)):
        core.push(batch, t_ingest_ns=k)
    steps = run_dry(core)
    assert [step.update.t_us for step in steps] == [4000, 8000]
    assert [step.t_ingest_ns for step in steps] == [3, 7]
    assert [step.whole for step in steps] == [False, True], "one batch is known to be missing in the first"
    assert [batch.t1_us for batch in tracker.batches] == [1000 * (k + 1) for k in range(8)], "load changes no update"
    assert core.counts["merged_batches"] == 6
    assert core.counts["updates"] == 8


def test_OVERLOAD_drops_the_oldest_and_says_so() -> None:
    tracker = RecordingTracker()
    core = EventTrackerCore(tracker, patience=1, most=2, most_waiting=4)
    for k, batch in enumerate(batches(10)):
        core.push(batch, t_ingest_ns=k)
    assert core.waiting == 4
    steps = run_dry(core)
    assert [step.update.t_us for step in steps] == [8000, 10_000]
    assert tracker.batches[0].lost_before == 7, "six dropped here, one known to be missing before"
    assert core.counts["lost_batches"] == 7


def test_OVERLOAD_thins_large_batches_only_while_others_wait_and_says_so() -> None:
    def large(k: int) -> EventBatch:
        events = empty_events(100)
        events["t"] = 1000 * k + np.arange(100)
        return EventBatch(1000 * k, 1000 * (k + 1), events)

    tracker = RecordingTracker()
    core = EventTrackerCore(tracker, patience=1, most=4, most_events=30)
    core.push(large(0), 0)
    step = core.step()
    assert step is not None
    assert step.whole
    assert len(tracker.batches[0].events) == 100
    assert not core.overloaded
    for k in (1, 2):
        core.push(large(k), k)
    step = core.step()
    assert step is not None
    assert not step.whole
    assert core.overloaded
    assert [batch.events["t"].tolist() for batch in tracker.batches[1:]] == [
        list(range(1000 * k, 1000 * k + 100, 4)) for k in (1, 2)
    ]
    assert core.counts["thinned_events"] == 150
    for k in range(3, 40):
        core.push(large(k), k)
        core.step()
    assert not core.overloaded, "back to normal"


def test_refused_corrections_are_counted_with_their_sender() -> None:
    core = EventTrackerCore(RecordingTracker(), patience=3)
    core.on_correction(correction(5), "fusion")
    core.on_correction(correction(-5), "fusion")
    assert core.counts["corrections"] == 1
    assert core.rejects.as_dict() == {"too_old": 1}
    assert core.rejects.senders() == {"fusion:too_old": 1}
