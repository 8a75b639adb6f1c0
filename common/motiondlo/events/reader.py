"""Read event files of any supported format in bounded memory."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import BinaryIO

from motiondlo.errors import RecordingError
from motiondlo.events.cutter import BatchCutter
from motiondlo.events.evt2 import Evt2Decoder, Evt21Decoder
from motiondlo.events.evt3 import Evt3Decoder
from motiondlo.events.joining import join
from motiondlo.events.raw_header import MAX_HEADER_BYTES, EventFormat, RawHeader, parse_raw_header
from motiondlo.events.stream_decoder import StreamDecoder
from motiondlo.events.types import EventArray, EventBatch, SensorGeometry, TriggerArray

READ_BYTES = 1 << 16
"""Larger reads gain nothing: decoded arrays would no longer be recycled by the allocator."""
_GEN3_GEOMETRY = SensorGeometry(640, 480)


def make_decoder(header: RawHeader, geometry: SensorGeometry) -> StreamDecoder:
    """A fresh decoder for the format that the header names."""
    if header.format is EventFormat.EVT3:
        return Evt3Decoder(geometry)
    if header.format is EventFormat.EVT2:
        return Evt2Decoder(geometry)
    return Evt21Decoder(geometry, header.swapped_halves)


class EventFile:
    """An event file whose header was read; every pass over it decodes anew, and always alike."""

    def __init__(self, path: Path, header: RawHeader, geometry: SensorGeometry) -> None:
        self.path = path
        self.header = header
        self.geometry = geometry
        self._last_decoder: StreamDecoder | None = None

    @property
    def format(self) -> EventFormat:
        """The encoding."""
        return self.header.format

    @property
    def damage(self) -> dict[str, int]:
        """Counts per kind of damage met by the latest pass so far; empty before the first, and for a sound file."""
        return {} if self._last_decoder is None else self._last_decoder.damage

    @property
    def marks(self) -> dict[str, int]:
        """``wraps`` and ``gaps`` of the camera's time words met by the latest pass so far."""
        return {} if self._last_decoder is None else self._last_decoder.marks

    def raw_chunks(self, size_bytes: int = READ_BYTES) -> Iterator[bytes]:
        """The encoded data behind the header, as a live camera would send it."""
        with self._open() as file:
            while chunk := file.read(size_bytes):
                yield chunk

    def chunks(self) -> Iterator[tuple[EventArray, TriggerArray, int]]:
        """Decoded pieces in time order: events (N,), triggers (K,), and the time before which all has come."""
        decoder = make_decoder(self.header, self.geometry)
        self._last_decoder = decoder
        for raw in self.raw_chunks():
            events, triggers = decoder.push(raw)
            yield events, triggers, decoder.time_us
        events, triggers = decoder.flush()
        yield events, triggers, decoder.time_us

    def batches(self, period_us: int = 1000, start_us: int = 0) -> Iterator[EventBatch]:
        """All events, cut on the grid of multiples of ``period_us``; see BatchCutter for where the first one starts.

        Silence gives empty batches; the last batch is the one that holds the last event or trigger.
        """
        cutter = BatchCutter(period_us, start_us)
        for events, triggers, now_us in self.chunks():
            yield from cutter.push(events, triggers, now_us)
        yield from cutter.finish()

    def _open(self) -> BinaryIO:
        try:
            file = self.path.open("rb")
        except OSError as error:
            raise RecordingError(f"{self.path}: cannot be read ({error.strerror}).", "Check the path.") from error
        file.seek(self.header.size_bytes)
        return file


def open_events(path: Path, geometry: SensorGeometry | None = None) -> EventFile:
    """Open a Prophesee RAW file (EVT3, EVT2 or EVT2.1).

    geometry: used where the header has none; without either, 640x480 for Gen3 sensors and 1280x720 for others.
    Raises RecordingError when the file cannot be read, is no Prophesee RAW file, or has an unsupported format.
    """
    try:
        with path.open("rb") as file:
            start = file.read(MAX_HEADER_BYTES)
    except OSError as error:
        raise RecordingError(f"{path}: cannot be read ({error.strerror}).", "Check the path.") from error
    header = parse_raw_header(start, str(path))
    if header.geometry is not None:
        geometry = header.geometry
    elif geometry is None:
        is_gen3 = "gen3" in header.fields.get("plugin_name", "")
        geometry = _GEN3_GEOMETRY if is_gen3 else SensorGeometry()
    return EventFile(path, header, geometry)


def read_all(path: Path, geometry: SensorGeometry | None = None) -> tuple[EventArray, TriggerArray]:
    """Every event (N,) and trigger (K,) of a file at once, for tools; 16 bytes each. Raises as :func:`open_events`."""
    parts = list(open_events(path, geometry).chunks())
    return join([p[0] for p in parts]), join([p[1] for p in parts])
