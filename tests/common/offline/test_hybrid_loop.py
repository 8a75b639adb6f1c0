from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from motiondlo.events.types import EventBatch, empty_events
from motiondlo.frames.types import Instance, Segmentation
from motiondlo.fusion.core import FusionCore
from motiondlo.fusion.params import FusionParams
from motiondlo.fusion.state import FrameRequest, FusedState, Mode
from motiondlo.offline.frame_hold import FrameHoldTracker
from motiondlo.offline.hybrid_loop import FrameBranch, HybridLoop
from motiondlo.recording.layout import FrameEntry
from motiondlo.rejects import RejectReason
from motiondlo.tracking.types import Correction, CorrectionKind, TrackUpdate

LATENCY_US = 30_000


def _frames(*times_us):
    return tuple(FrameEntry(f"frame_{k:06d}.jpg", Path(f"frame_{k:06d}.jpg"), t) for k, t in enumerate(times_us))


def _batch(k, period_us=1000):
    return EventBatch(k * period_us, (k + 1) * period_us, empty_events())


def _correction(seq, t_us):
    none = np.zeros(2)
    return Correction(seq, 0, t_us, CorrectionKind.REINITIALISE, np.array([[0.0, 0.0], [9.0, 0.0]]), none, none)


class FakeFusion:
    """Asks for frames at given times and writes down when segmentations reach it."""

    def __init__(self, requests=()):
        self.requests = dict(requests)
        self.arrived: list[tuple[int, int]] = []
        self.now_us = -1

    def on_track(self, update):
        self.now_us = update.t_us
        return FusedState(update.t_us, update.t_events_us, Mode.STATIC, ())

    def corrections_due(self):
        return ()

    def frame_request(self):
        return self.requests.pop(self.now_us, None)

    def awaits(self, request):
        return True

    def on_segmentation(self, segmentation, now_us, number=None):
        self.arrived.append((segmentation.t_us, now_us))
        return (_correction(len(self.arrived), segmentation.t_us),)


class FakeTracker:
    """Writes down in which order batches and corrections come."""

    def __init__(self, refuse=None):
        self.refuse = refuse
        self.log: list[str] = []

    def correct(self, correction):
        self.log.append(f"correction of {correction.t_us}")
        return self.refuse

    def update(self, batch):
        self.log.append(f"update to {batch.t1_us}")
        return TrackUpdate(batch.t1_us, -1, ())


def _run(fusion, frames, batches, tracker=None, segment=None, latency_us=LATENCY_US, ask_always=False):
    taken: list[int] = []

    def record(entry):
        taken.append(entry.t_us)
        return Segmentation(entry.t_us, entry.name)

    tracker = FakeTracker() if tracker is None else tracker
    loop = HybridLoop(tracker, fusion, FrameBranch(frames, segment or record, latency_us, ask_always))
    loop.start(0)
    for k in range(batches):
        loop.step(_batch(k))
    return loop, tracker, taken


def test_first_frame_is_segmented_before_the_first_update():
    fusion = FakeFusion({-1: FrameRequest("boot", -1)})
    _, tracker, taken = _run(fusion, _frames(12_000, 62_000), 2)
    assert taken == [12_000]
    assert fusion.arrived == [(12_000, 0)]
    assert tracker.log[:2] == ["correction of 12000", "update to 1000"]


def test_later_segmentation_arrives_its_latency_after_it_was_asked_for():
    fusion = FakeFusion({20_000: FrameRequest("rest", -1)})
    _, tracker, taken = _run(fusion, _frames(12_000, 62_000), 60)
    assert taken == [12_000]
    assert fusion.arrived == [(12_000, 50_000)]
    # It is there at 50 ms: the update to 50 ms is the first that may use it.
    at = tracker.log.index("correction of 12000")
    assert tracker.log[at - 1 : at + 2] == ["update to 49000", "correction of 12000", "update to 50000"]


def test_newest_frame_is_taken_and_never_one_from_the_future():
    fusion = FakeFusion({61_000: FrameRequest("rest", -1)})
    _, _, taken = _run(fusion, _frames(12_000, 40_000, 61_500, 62_000), 100)
    assert taken == [40_000]


def test_request_for_a_later_frame_waits_for_it_and_so_does_its_latency():
    fusion = FakeFusion({20_000: FrameRequest("rest", 20_000)})
    _, _, taken = _run(fusion, _frames(12_000, 62_300), 100)
    assert taken == [62_300]
    assert fusion.arrived == [(62_300, 93_000)]


def test_one_segmentation_at_a_time():
    fusion = FakeFusion({15_000: FrameRequest("a", -1), 20_000: FrameRequest("b", -1)})
    _, _, taken = _run(fusion, _frames(12_000, 18_000, 44_000), 100)
    assert taken == [12_000, 44_000]
    assert fusion.arrived == [(12_000, 45_000), (44_000, 75_000)]


def test_refused_corrections_and_failed_segmentations_are_counted():
    fusion = FakeFusion({-1: FrameRequest("boot", -1)})
    loop, _, _ = _run(
        fusion,
        _frames(12_000),
        1,
        tracker=FakeTracker(refuse=RejectReason.TOO_OLD),
        segment=lambda entry: Segmentation(entry.t_us, entry.name, failure="blurred"),
    )
    assert loop.rejects.as_dict() == {"too_old": 1}
    assert loop.failures == ["frame_000000.jpg: blurred"]


def test_no_frame_branch_never_asks():
    fusion = FakeFusion({-1: FrameRequest("boot", -1), 1000: FrameRequest("rest", -1)})
    loop = HybridLoop(FakeTracker(), fusion, None)
    loop.start(0)
    assert loop.step(_batch(0)).t_us == 1000
    assert len(fusion.requests) == 2


def _seen(entry, y):
    nodes = np.stack([np.linspace(100.0, 500.0, 12), np.full(12, y)], axis=1)
    instance = Instance(nodes, nodes, np.full(12, 1.5), 20.0, 24.0, 0.9)
    return Segmentation(entry.t_us, entry.name, (instance,))


@pytest.mark.parametrize("latency_us", [0, LATENCY_US])
def test_frame_mode_holds_each_shape_until_the_next_one_arrives(latency_us):
    frames = _frames(12_000, 50_000, 100_000)
    fusion = FusionCore(FusionParams(lead_ms=0.0))
    branch = FrameBranch(frames, lambda entry: _seen(entry, entry.t_us / 10_000.0), latency_us, ask_always=True)
    loop = HybridLoop(FrameHoldTracker(), fusion, branch)
    loop.start(0)
    shown = {}
    for k in range(150):
        state = loop.step(_batch(k))
        (dlo,) = state.dlos
        assert (dlo.id, dlo.source) == (0, "frame")
        np.testing.assert_allclose(dlo.sigma_px, np.hypot(1.5, 1.0))
        shown.setdefault(float(dlo.nodes[0, 1]), state.t_us)
    # Asked for when the frame is there; without latency it is used by the next update.
    wait_us = max(latency_us, 1000)
    assert shown == {1.2: 1000, 5.0: 50_000 + wait_us, 10.0: 100_000 + wait_us}


def test_held_shape_ends_when_it_is_retired_and_an_older_one_is_refused():
    tracker = FrameHoldTracker()
    assert tracker.correct(_correction(1, 50_000)) is None
    assert len(tracker.update(_batch(0)).tracks) == 1
    assert tracker.correct(_correction(2, 40_000)) is RejectReason.OUT_OF_ORDER
    none = np.zeros(0)
    tracker.correct(Correction(3, 0, 60_000, CorrectionKind.RETIRE, np.zeros((0, 2)), none, none))
    assert tracker.update(_batch(1)).tracks == ()
