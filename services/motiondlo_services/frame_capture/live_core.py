"""Which frame of a live camera answers a request. No I/O, no clock, no bus.

A request for "after t" is answered with a frame whose exposure started at or after t; one for "any" with a frame whose
exposure started after the request came in. A frame that was not paired with a trigger has no time, and answers nothing.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from motiondlo.cameras.interface import Frame
from motiondlo.cameras.pairing import FramePairing, PairedFrame, PairingParams


@dataclass(frozen=True)
class LiveCapture:
    """A frame to hand out, and the request that it answers (0: nobody asked, it is for the recorder)."""

    paired: PairedFrame
    request_id: int


class LiveCaptureCore:
    """Pairs frames with triggers, and keeps at most one request waiting; a newer one replaces it."""

    def __init__(self, params: PairingParams, publish_all: bool) -> None:
        self.pairing = FramePairing(params)
        self._publish_all = publish_all
        self._epoch: int | None = None
        self._newest: PairedFrame | None = None
        self._event_us: Callable[[int], int] | None = None
        self._request: tuple[int, int] | None = None
        self.triggers = 0
        self.paired = 0

    @property
    def waiting(self) -> bool:
        """A request waits for its frame."""
        return self._request is not None

    def on_clock(self, event_us: Callable[[int], int], epoch: int) -> None:
        """The event clock on the host's; another ``epoch``: it has started anew."""
        if self._epoch is not None and epoch != self._epoch:
            self.pairing.forget_events()
            self._newest = None
        self._epoch = epoch
        self._event_us = event_us
        self.pairing.on_clock(event_us)

    def on_trigger(self, t_us: int) -> None:
        """An exposure starts at ``t_us``."""
        self.triggers += 1
        self.pairing.on_trigger(t_us)

    def on_frame(self, frame: Frame) -> None:
        """The camera sent a frame."""
        self.pairing.on_frame(frame)

    def on_camera(self) -> None:
        """The camera was opened (anew)."""
        self.pairing.forget_camera()

    def on_request(self, request_id: int, after_us: int, now_ns: int) -> list[LiveCapture]:
        """Somebody wants a frame taken at or after ``after_us``; -1: after now."""
        if after_us < 0 and self._event_us is not None:
            after_us = self._event_us(now_ns)
        self._request = (request_id, after_us)
        return [] if self._newest is None else self._answer(self._newest)

    def withdraw(self, request_id: int) -> None:
        """Nobody needs the frame of this request any more."""
        if self._request is not None and self._request[0] == request_id:
            self._request = None

    def step(self, now_ns: int) -> list[LiveCapture]:
        """The frames to hand out now."""
        captures = []
        for paired in self.pairing.pairs(now_ns):
            self.paired += 1
            self._newest = paired
            answers = self._answer(paired)
            if not answers and self._publish_all:
                answers = [LiveCapture(paired, 0)]
            captures += answers
        return captures

    def _answer(self, paired: PairedFrame) -> list[LiveCapture]:
        if self._request is None or paired.t_us < self._request[1]:
            return []
        request_id, _ = self._request
        self._request = None
        return [LiveCapture(paired, request_id)]
