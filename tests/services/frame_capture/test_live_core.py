"""Requests to a live camera: nobody gets a frame older than wanted, or one without a time."""

from __future__ import annotations

import numpy as np

from motiondlo.cameras.interface import Frame
from motiondlo.cameras.pairing import PairingParams
from motiondlo_services.frame_capture.live_core import LiveCapture, LiveCaptureCore

IMAGE = np.zeros((1, 1, 3), np.uint8)
PERIOD_US = 50_000


def event_us(host_ns: int) -> int:
    return host_ns // 1000


class Cell:
    """A trigger every 50 ms, its frame 20 ms later."""

    def __init__(self, publish_all: bool = False) -> None:
        params = PairingParams(min_latency_us=5_000, max_latency_us=40_000, min_interval_us=45_000)
        self.core = LiveCaptureCore(params, publish_all)
        self.core.on_clock(event_us, 0)

    def expose(self, k: int, trigger: bool = True, frame: bool = True) -> list[tuple[int, int]]:
        """(time, request) of what is handed out."""
        if trigger:
            self.core.on_trigger(k * PERIOD_US)
        arrived_ns = (k * PERIOD_US + 20_000) * 1000
        if frame:
            self.core.on_frame(Frame(IMAGE, arrived_ns, k, k * PERIOD_US * 1000))
        return told(self.core.step(arrived_ns))


def told(captures: list[LiveCapture]) -> list[tuple[int, int]]:
    return [(capture.paired.t_us, capture.request_id) for capture in captures]


def test_a_request_gets_a_frame_of_its_time_or_later() -> None:
    cell = Cell()
    assert cell.expose(1) == []
    assert told(cell.core.on_request(1, 60_000, 75_000_000)) == []
    assert cell.expose(2) == [(100_000, 1)]
    assert told(cell.core.on_request(2, 90_000, 125_000_000)) == [(100_000, 2)], "the newest is new enough"
    assert cell.expose(3) == []


def test_a_request_for_any_frame_gets_one_taken_after_it() -> None:
    cell = Cell()
    cell.expose(1)
    assert told(cell.core.on_request(1, -1, 80_000_000)) == []
    assert cell.expose(2) == [(100_000, 1)]


def test_TRIGGER_DROPPED_its_frame_answers_nothing() -> None:
    cell = Cell()
    cell.core.on_request(1, 60_000, 75_000_000)
    assert cell.expose(2, trigger=False) == []
    assert cell.expose(3) == [(150_000, 1)]
    assert cell.core.pairing.rejects.as_dict() == {"frame_without_trigger": 1}


def test_FRAME_DROPPED_the_next_one_answers() -> None:
    cell = Cell()
    cell.core.on_request(1, 60_000, 75_000_000)
    assert cell.expose(2, frame=False) == []
    assert cell.expose(3) == [(150_000, 1)]


def test_a_newer_request_replaces_one_that_waits() -> None:
    cell = Cell()
    cell.core.on_request(1, 60_000, 75_000_000)
    cell.core.on_request(2, 120_000, 76_000_000)
    assert cell.expose(2) == []
    assert cell.expose(3) == [(150_000, 2)]


def test_a_withdrawn_request_gets_no_frame() -> None:
    cell = Cell()
    cell.core.on_request(1, 60_000, 75_000_000)
    cell.core.withdraw(1)
    assert cell.expose(2) == []


def test_a_recorder_gets_every_frame() -> None:
    cell = Cell(publish_all=True)
    assert cell.expose(1) == [(50_000, 0)]
    cell.core.on_request(7, 80_000, 75_000_000)
    assert cell.expose(2) == [(100_000, 7)]


def test_CLOCK_ANEW_old_frames_answer_no_more() -> None:
    cell = Cell()
    cell.expose(2)
    cell.core.on_clock(event_us, 1)
    assert told(cell.core.on_request(1, 60_000, 125_000_000)) == []
    assert cell.expose(3) == [(150_000, 1)]
