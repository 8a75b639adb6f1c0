"""Pairing of frames and triggers, and which frame a request gets."""

from __future__ import annotations

from pathlib import Path

from motiondlo.recording.layout import FrameEntry
from motiondlo.rejects import RejectReason
from motiondlo_services.frame_capture.core import CaptureCore


def frames(*times_us: int) -> tuple[FrameEntry, ...]:
    return tuple(FrameEntry(f"frame_{k}.jpg", Path(f"frame_{k}.jpg"), t) for k, t in enumerate(times_us))


def test_request_before_the_first_trigger_gets_the_first_frame() -> None:
    core = CaptureCore(frames(12_000, 62_000), tolerance_us=1000)
    (capture,) = core.on_request(1, -1)
    assert (capture.entry.t_us, capture.request_id) == (12_000, 1)


def test_request_for_a_later_frame_waits_for_its_trigger() -> None:
    core = CaptureCore(frames(12_000, 62_000), tolerance_us=1000)
    assert core.on_trigger(12_000) == []
    assert core.on_request(5, 40_000) == []
    assert core.waiting
    (capture,) = core.on_trigger(62_010)
    assert (capture.entry.t_us, capture.request_id) == (62_000, 5)
    assert not core.waiting


def test_request_for_the_past_gets_the_newest_frame() -> None:
    core = CaptureCore(frames(12_000, 62_000), tolerance_us=1000)
    core.on_trigger(12_000)
    core.on_trigger(62_000)
    assert [c.entry.t_us for c in core.on_request(2, 10_000)] == [62_000]


def test_FRAME_DROPPED_does_not_shift_the_others() -> None:
    core = CaptureCore(frames(12_000, 112_000), tolerance_us=1000, publish_all=True)
    seen = [c.entry.t_us for t in (12_000, 62_000, 112_000) for c in core.on_trigger(t)]
    assert seen == [12_000, 112_000]
    assert core.rejects.as_dict() == {RejectReason.TRIGGER_WITHOUT_FRAME: 1}


def test_TRIGGER_DROPPED_does_not_shift_the_others() -> None:
    core = CaptureCore(frames(12_000, 62_000, 112_000), tolerance_us=1000, publish_all=True)
    seen = [c.entry.t_us for t in (12_000, 112_000) for c in core.on_trigger(t)]
    assert seen == [12_000, 112_000]
    assert core.rejects.as_dict() == {RejectReason.FRAME_WITHOUT_TRIGGER: 1}


def test_a_withdrawn_request_gets_no_frame() -> None:
    core = CaptureCore(frames(12_000, 62_000), tolerance_us=1000)
    core.on_trigger(12_000)
    assert core.on_request(7, 20_000) == []
    core.withdraw(6)
    assert core.waiting
    core.withdraw(7)
    assert core.on_trigger(62_000) == []
    assert not core.waiting
