"""Streaming decoders for Prophesee EVT2 (32-bit words) and EVT2.1 (64-bit words with vectors of 32 pixels)."""

from __future__ import annotations

from motiondlo.events.evt2_kernels import decode_evt2, decode_evt21, decode_evt21_swapped, resume_evt2
from motiondlo.events.resync_kernels import FORMAT_EVT2, FORMAT_EVT21, FORMAT_EVT21_SWAPPED
from motiondlo.events.stream_decoder import StreamDecoder
from motiondlo.events.types import SensorGeometry


class Evt2Decoder(StreamDecoder):
    """EVT2 bytes (without the file header) to events; survives damage, and counts it.

    geometry: events outside it are dropped and counted. Times are microseconds, 34-bit wraps unrolled.
    """

    def __init__(self, geometry: SensorGeometry) -> None:
        super().__init__(
            geometry,
            kernel=decode_evt2,
            resume=resume_evt2,
            resync_format=FORMAT_EVT2,
            word_bytes=4,
            events_per_word=1,
            low_bits=6,
            high_bits=28,
        )


class Evt21Decoder(StreamDecoder):
    """EVT2.1 bytes (without the file header) to events; survives damage, and counts it.

    swapped: the upper 32 bits of every word come first, as IMX636 sensors send it (header: ``endianness=legacy``).
    """

    def __init__(self, geometry: SensorGeometry, swapped: bool = False) -> None:
        super().__init__(
            geometry,
            kernel=decode_evt21_swapped if swapped else decode_evt21,
            resume=resume_evt2,
            resync_format=FORMAT_EVT21_SWAPPED if swapped else FORMAT_EVT21,
            word_bytes=8,
            events_per_word=32,
            low_bits=6,
            high_bits=28,
        )
