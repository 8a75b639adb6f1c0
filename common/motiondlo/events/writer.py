"""Write events and triggers as a Prophesee EVT3 RAW file."""

from __future__ import annotations

from pathlib import Path
from types import TracebackType

import numpy as np

from motiondlo.errors import RecordingError
from motiondlo.events.joining import event_words, trigger_words
from motiondlo.events.reader import open_events
from motiondlo.events.types import EventArray, SensorGeometry, TriggerArray, empty_triggers
from motiondlo.events.writer_kernels import W_COUNT, W_HIGH, W_LOW, WORDS_PER_ITEM, encode_evt3

_MAX_SIDE_PX = 2048


def evt3_header(geometry: SensorGeometry) -> bytes:
    """The header of an EVT3 RAW file for a sensor of this size."""
    width, height = geometry.width_px, geometry.height_px
    lines = (
        "evt 3.0",
        f"format EVT3;height={height};width={width}",
        f"geometry {width}x{height}",
        "integrator_name MotionDLO",
        "end",
    )
    return "".join(f"% {line}\n" for line in lines).encode()


class Evt3Encoder:
    """Events to EVT3 words, piece by piece; the pieces joined decode to all events."""

    def __init__(self, geometry: SensorGeometry) -> None:
        if not (0 < geometry.width_px <= _MAX_SIDE_PX and 0 < geometry.height_px <= _MAX_SIDE_PX):
            raise ValueError(f"EVT3 cannot hold a sensor of {geometry.width_px}x{geometry.height_px} px")
        self.geometry = geometry
        self._state = np.full(W_COUNT, -1, np.int64)
        self._t_us = 0

    def encode(self, events: EventArray, triggers: TriggerArray | None = None) -> bytes:
        """EVT3 words for events (N,) and triggers (K,), both in time order and not before earlier pieces.

        Raises ValueError for times that decrease or are negative, and for events outside the sensor.
        """
        triggers = empty_triggers() if triggers is None else triggers
        last_us = max(self._checked_end(events), self._checked_end(triggers))
        if len(events) and (
            events["x"].max() >= self.geometry.width_px or events["y"].max() >= self.geometry.height_px
        ):
            raise ValueError("an event lies outside the sensor")
        packed = event_words(events)
        packed_triggers = trigger_words(triggers)
        first_us = min((int(part["t"][0]) for part in (events, triggers) if len(part)), default=last_us)
        highs = (last_us >> 12) - (self._t_us >> 12 if self._state[0] >= 0 else first_us >> 12) + 1
        words = np.empty(WORDS_PER_ITEM * (len(packed) + len(packed_triggers)) + highs, "<u2")
        n = encode_evt3(packed, packed_triggers, words, self._state)
        self._t_us = last_us
        return words[:n].tobytes()

    def tell_time(self, t_us: int) -> bytes:
        """Words that say that it is ``t_us`` and nothing has happened since the last piece, as a camera sends them.

        Raises ValueError for a time before the last piece's end.
        """
        if t_us < self._t_us:
            raise ValueError("times decrease")
        high, low = t_us >> 12, t_us & 0xFFF
        first = int(self._state[W_HIGH]) + 1 if self._state[W_HIGH] >= 0 else high
        words = [*(0x8000 | part & 0xFFF for part in range(first, high + 1)), 0x6000 | low]
        self._state[W_HIGH], self._state[W_LOW] = high, low
        self._t_us = t_us
        return np.array(words, "<u2").tobytes()

    def _checked_end(self, part: EventArray) -> int:
        if not len(part):
            return self._t_us
        if part["t"][0] < self._t_us or (np.diff(part["t"]) < 0).any():
            raise ValueError("times decrease")
        return int(part["t"][-1])


class Evt3Writer:
    """An EVT3 RAW file that grows piece by piece; a context manager."""

    def __init__(self, path: Path, geometry: SensorGeometry) -> None:
        """Create the file. Raises RecordingError when that is impossible."""
        self._encoder = Evt3Encoder(geometry)
        try:
            self._file = path.open("wb")
        except OSError as error:
            raise RecordingError(f"{path}: cannot be written ({error.strerror}).", "Choose another folder.") from error
        self._file.write(evt3_header(geometry))

    def write(self, events: EventArray, triggers: TriggerArray | None = None) -> None:
        """Append events and triggers. Raises as Evt3Encoder.encode, and OSError when the disk is full."""
        self._file.write(self._encoder.encode(events, triggers))

    def close(self) -> None:
        """Finish the file."""
        self._file.close()

    def __enter__(self) -> Evt3Writer:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, value: BaseException | None, traceback: TracebackType | None
    ) -> None:
        self.close()


def crop_recording_events(src: Path, dst: Path, t0_us: int, t1_us: int) -> int:
    """Write what ``src`` holds with ``t0_us <= t < t1_us`` to ``dst`` as EVT3, times shifted so that t0_us becomes 0.

    Returns the number of events. Raises RecordingError when ``src`` is no event file or ``dst`` cannot be written, and
    ValueError for an empty span.
    """
    if t1_us <= t0_us:
        raise ValueError(f"empty span from {t0_us} to {t1_us} us")
    source = open_events(src)
    written = 0
    with Evt3Writer(dst, source.geometry) as writer:
        for events, triggers, now_us in source.chunks():
            pieces = []
            for part in (events, triggers):
                piece = part[np.searchsorted(part["t"], t0_us) : np.searchsorted(part["t"], t1_us)].copy()
                piece["t"] -= t0_us
                pieces.append(piece)
            writer.write(pieces[0], pieces[1])
            written += len(pieces[0])
            if now_us >= t1_us:
                break
    return written
