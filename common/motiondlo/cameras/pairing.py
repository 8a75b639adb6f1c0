"""Which trigger a frame belongs to, so that no loss on either side can shift the pairs by one. No I/O, no clock.

A frame's trigger lies within an interval: it arrived between ``min_latency`` and ``max_latency`` after it. While that
interval is shorter than the least distance of two triggers, it holds the frame's own trigger or (when that was lost)
none: whatever is found in it is right. An interval that is longer decides nothing, and its frame is left unpaired.

Where the camera has a clock of its own, the intervals of successive frames speak of one unknown, the distance of the
two clocks, and their intersection shrinks with the jitter of arrival; the first pair then fixes it, and from there on a
frame's trigger is expected to within ``tolerance_us``, however late the frame arrives. A pair that the frame counter
contradicts (more exposures than triggers fit between two pairs) is refused, and the distance is learned anew.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass

from pydantic import BaseModel, ConfigDict, Field

from motiondlo.cameras.interface import UNKNOWN, Frame
from motiondlo.rejects import RejectCounter, RejectReason

MAX_WAITING = 8
"""Frames that wait for their triggers; of 2592x1944 they hold 120 MB."""
LATE_IN_A_ROW = 5
"""So many frames in a row later than the bound: not they are late, the distance of the clocks is wrong."""


class PairingParams(BaseModel):
    """What is known of the trigger line and the camera."""

    model_config = ConfigDict(frozen=True, strict=True, extra="forbid")

    min_latency_us: int = Field(ge=0, description="from trigger to arrival, at least")
    max_latency_us: int = Field(gt=0, description="from trigger to arrival, at most")
    min_interval_us: int = Field(gt=0, description="distance of two triggers, at least")
    tolerance_us: int = Field(default=2000, ge=1, description="of the camera's clock, once it is known")
    max_drift_ppm: float = Field(default=200.0, ge=0.0, description="of the camera's clock against the event camera's")
    patience_us: int = Field(default=200_000, ge=0, description="a trigger may be told so much later than its frame")


@dataclass(frozen=True)
class PairedFrame:
    """A frame and the trigger it belongs to."""

    frame: Frame
    t_us: int
    """Its trigger's time: the start of the exposure, event clock."""
    trigger_id: int
    """Number of the trigger since the start."""


class FramePairing:
    """Takes triggers and frames in any interleaving, gives pairs; each trigger and each frame is used once at most."""

    def __init__(self, params: PairingParams) -> None:
        self._params = params
        self._event_us: Callable[[int], int] | None = None
        self._triggers: deque[tuple[int, int]] = deque()
        self._frames: deque[Frame] = deque()
        self._numbered = 0
        self.rejects = RejectCounter()
        self.frames_lost = 0
        """Frames that the camera counted and that never arrived."""
        self.ambiguous = 0
        """Frames left without a trigger because the bounds on the latency admit more than one."""
        self.contradictions = 0
        """Pairs refused because the frame counter speaks against them."""
        self._counter = UNKNOWN
        self._last_pair: tuple[int, int] | None = None
        self._offset_us: int | None = None
        self._offset_at_us = 0
        self._bounds_us: tuple[int, int] | None = None
        self._bounded_at_us: int | None = None
        self._late_in_a_row = 0

    def forget_camera(self) -> None:
        """The camera was opened anew: its counter and clock have started again."""
        while self._frames:
            self._frames.popleft()
            self.rejects.count(RejectReason.FRAME_WITHOUT_TRIGGER)
        self._counter = UNKNOWN
        self._last_pair = None
        self._forget_clock()

    def forget_events(self) -> None:
        """The event clock has started anew: no trigger so far says anything of frames to come."""
        self.rejects.count(RejectReason.TRIGGER_WITHOUT_FRAME, n=len(self._triggers))
        self._triggers.clear()
        self._event_us = None
        self.forget_camera()

    def on_clock(self, event_us: Callable[[int], int]) -> None:
        """``event_us``: the event time, us, of a host monotonic time, ns."""
        self._event_us = event_us

    def on_trigger(self, t_us: int) -> None:
        """An exposure starts at ``t_us``; triggers come in time order."""
        self._triggers.append((t_us, self._numbered))
        self._numbered += 1

    def on_frame(self, frame: Frame) -> None:
        """A frame arrived; frames come in the order in which they were taken."""
        if frame.counter != UNKNOWN:
            if self._counter != UNKNOWN:
                if frame.counter <= self._counter:
                    self.rejects.count(RejectReason.REPEATED)
                    return
                self.frames_lost += frame.counter - self._counter - 1
            self._counter = frame.counter
        self._frames.append(frame)
        while len(self._frames) > MAX_WAITING:
            self._frames.popleft()
            self.rejects.count(RejectReason.FRAME_WITHOUT_TRIGGER)

    def pairs(self, now_ns: int) -> list[PairedFrame]:
        """The pairs that are certain by ``now_ns`` (host monotonic); what has waited too long is counted and left."""
        if self._event_us is None:
            return []
        now_us = self._event_us(now_ns)
        found = []
        while self._frames:
            frame = self._frames[0]
            low_us, high_us = self._interval_us(frame)
            if high_us - low_us >= self._params.min_interval_us:
                self._frames.popleft()
                self.ambiguous += 1
                self.rejects.count(RejectReason.FRAME_WITHOUT_TRIGGER)
                continue
            self._pass_over(low_us)
            if self._triggers and self._triggers[0][0] <= high_us:
                self._frames.popleft()
                t_us, number = self._triggers[0]
                if self._contradicted(frame, t_us):
                    self.contradictions += 1
                    self.rejects.count(RejectReason.FRAME_WITHOUT_TRIGGER)
                    self._forget_clock()
                    self._last_pair = None
                    continue
                self._triggers.popleft()
                self._learn(frame, t_us)
                found.append(PairedFrame(frame, t_us, number))
            elif self._triggers or now_us > self._event_us(frame.arrived_ns) + self._params.patience_us:
                # A later trigger is known already, or its own would have been told by now.
                self._frames.popleft()
                self.rejects.count(RejectReason.FRAME_WITHOUT_TRIGGER)
            else:
                break
        if not self._frames:
            self._pass_over(now_us - self._params.max_latency_us - self._params.patience_us)
        return found

    def _interval_us(self, frame: Frame) -> tuple[int, int]:
        """Event times between which the frame's trigger lies."""
        assert self._event_us is not None
        params = self._params
        arrived_us = self._event_us(frame.arrived_ns)
        low_us, high_us = arrived_us - params.max_latency_us, arrived_us - params.min_latency_us
        if frame.device_ns == UNKNOWN:
            return low_us, high_us
        device_us = frame.device_ns // 1000
        if self._offset_us is not None:
            span_us = abs(device_us - self._offset_at_us)
            slack_us = params.tolerance_us + int(span_us * params.max_drift_ppm * 1e-6)
            return device_us + self._offset_us - slack_us, device_us + self._offset_us + slack_us
        # Every frame bounds the distance of the clocks; widened by what they may have drifted in between.
        drift_us = 0
        if self._bounded_at_us is not None:
            drift_us = 1 + int(abs(device_us - self._bounded_at_us) * params.max_drift_ppm * 1e-6)
        low, high = low_us - device_us, high_us - device_us
        if self._bounds_us is not None:
            low, high = max(low, self._bounds_us[0] - drift_us), min(high, self._bounds_us[1] + drift_us)
        if low > high:  # the bounds on the latency are not true
            low, high = low_us - device_us, high_us - device_us
        self._bounds_us, self._bounded_at_us = (low, high), device_us
        return device_us + low, device_us + high

    def _learn(self, frame: Frame, t_us: int) -> None:
        if frame.device_ns != UNKNOWN:
            device_us = frame.device_ns // 1000
            self._offset_us, self._offset_at_us = t_us - device_us, device_us
        if frame.counter != UNKNOWN:
            self._last_pair = (frame.counter, t_us)

    def _contradicted(self, frame: Frame, t_us: int) -> bool:
        """Whether the frame came before its exposure, or more exposures were counted than triggers fit in between."""
        assert self._event_us is not None
        latency_us = self._event_us(frame.arrived_ns) - t_us
        self._late_in_a_row = self._late_in_a_row + 1 if latency_us > self._params.max_latency_us else 0
        if latency_us < self._params.min_latency_us - self._params.tolerance_us or self._late_in_a_row >= LATE_IN_A_ROW:
            return True
        if self._last_pair is None or frame.counter == UNKNOWN:
            return False
        counter, before_us = self._last_pair
        return t_us - before_us < (frame.counter - counter) * self._params.min_interval_us - self._params.tolerance_us

    def _pass_over(self, before_us: int) -> None:
        while self._triggers and self._triggers[0][0] < before_us:
            self._triggers.popleft()
            self.rejects.count(RejectReason.TRIGGER_WITHOUT_FRAME)

    def _forget_clock(self) -> None:
        self._offset_us = self._bounds_us = self._bounded_at_us = None
        self._late_in_a_row = 0
