"""An event camera that is not there: a recording as a live stream of EVT3 bytes, with the faults that are wanted."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from itertools import count
from pathlib import Path

import numpy as np

from motiondlo.cameras.config import SimulatedSection
from motiondlo.cameras.interface import Camera, CameraLost, EventChunk, FoundDevice
from motiondlo.cameras.simulated import Plug, Scene
from motiondlo.events.reader import open_events
from motiondlo.events.types import EventArray, TriggerArray
from motiondlo.events.writer import Evt3Encoder

PIECE_US = 1000
"""Length of a piece in the recording's time."""
TRIGGER_TOLERANCE_US = 2000


class SimulatedEventCamera(Camera[EventChunk]):
    """Its clock starts at 0 whenever it is opened, as a real camera's does."""

    name = "simulated event camera"

    def __init__(
        self,
        section: SimulatedSection,
        recording: Path,
        now_ns: Callable[[], int] = time.monotonic_ns,
        sleep: Callable[[float], None] = time.sleep,
    ) -> None:
        """Raises RecordingError."""
        self._scene = Scene(recording, section.slow_motion)
        self._events = open_events(self._scene.recording.events_path)
        self._plug = Plug(section.event_unplugged_s, now_ns)
        self._dropped_us = np.array(
            [
                self._scene.recording.frames[k].t_us
                for k in section.dropped_triggers
                if k < len(self._scene.exposures_us)
            ]
        )
        self._now_ns, self._sleep = now_ns, sleep
        self._pieces: Iterator[tuple[bytes, int]] | None = None
        self._next: tuple[bytes, int] | None = None

    def open(self) -> None:
        """Raises CameraLost while it is unplugged."""
        self._plug.check()
        opened_us = self._now_ns() // 1000
        self._pieces = self._stream(opened_us)
        self._next = None

    def read(self, timeout_s: float) -> EventChunk | None:
        """The next piece when it is due. Raises CameraLost."""
        if self._pieces is None:
            raise CameraLost("is not open")
        self._plug.check()
        if self._next is None:
            self._next = next(self._pieces)
        raw, due_us = self._next
        wait_s = due_us * 1e-6 - self._now_ns() * 1e-9
        if wait_s > 0:
            self._sleep(min(wait_s, timeout_s))
            if wait_s > timeout_s:
                return None
        self._next = None
        return EventChunk(raw, self._now_ns())

    def close(self) -> None:
        """Stop."""
        self._pieces = self._next = None

    def find(self) -> list[FoundDevice]:
        """Itself."""
        return [FoundDevice("simulated", self._scene.recording.name)]

    def _stream(self, opened_us: int) -> Iterator[tuple[bytes, int]]:
        """EVT3 bytes, and the host time, us, at which they are due, from ``opened_us`` on, without end."""
        encoder = Evt3Encoder(self._events.geometry)
        slow = self._scene.slow_motion
        first, since_us = self._scene.round_of(opened_us * 1000)
        for number in count(first):
            start_us = number * self._scene.round_us
            skip_us = int(since_us / slow) // PIECE_US * PIECE_US if number == first else 0
            told_us = max(start_us, opened_us)
            for batch in self._events.batches(PIECE_US, skip_us):
                t1_us = start_us + round(batch.t1_us * slow)
                if batch.t1_us * slow > self._scene.round_us:
                    break
                if t1_us <= opened_us or batch.t0_us < skip_us:
                    continue
                parts = [
                    self._moved(part, slow, start_us - opened_us) for part in (batch.events, self._kept(batch.triggers))
                ]
                raw = encoder.encode(parts[0], parts[1])
                # A camera tells its time also when nothing happens.
                yield raw or encoder.tell_time(t1_us - opened_us), t1_us
                told_us = t1_us
            # So it does from the recording's end to that of the round.
            for t1_us in range(told_us + PIECE_US, start_us + self._scene.round_us, PIECE_US):
                yield encoder.tell_time(t1_us - opened_us), t1_us

    @staticmethod
    def _moved(part: EventArray, slow: float, shift_us: int) -> EventArray:
        moved: EventArray = part.copy()
        moved["t"] = np.round(part["t"] * slow).astype(np.int64) + shift_us
        kept: EventArray = moved[moved["t"] >= 0]
        return kept

    def _kept(self, triggers: TriggerArray) -> TriggerArray:
        """Without the rising edges of exposures whose trigger gets lost."""
        if not len(self._dropped_us) or not len(triggers):
            return triggers
        far = np.abs(triggers["t"][:, None] - self._dropped_us[None, :]).min(axis=1) > TRIGGER_TOLERANCE_US
        kept: TriggerArray = triggers[far | (triggers["edge"] == 0)]
        return kept
