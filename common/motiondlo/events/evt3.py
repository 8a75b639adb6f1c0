"""Streaming decoder for Prophesee EVT3 (16-bit words, vectors, external triggers)."""

from __future__ import annotations

from motiondlo.events.evt3_kernels import decode_evt3, resume_evt3
from motiondlo.events.resync_kernels import FORMAT_EVT3
from motiondlo.events.stream_decoder import StreamDecoder
from motiondlo.events.types import SensorGeometry


class Evt3Decoder(StreamDecoder):
    """EVT3 bytes (without the file header) to events; survives damage, and counts it.

    geometry: events outside it are dropped and counted. Times are microseconds, 24-bit wraps unrolled.
    """

    def __init__(self, geometry: SensorGeometry) -> None:
        super().__init__(
            geometry,
            kernel=decode_evt3,
            resume=resume_evt3,
            resync_format=FORMAT_EVT3,
            word_bytes=2,
            events_per_word=12,
            low_bits=12,
            high_bits=12,
        )
