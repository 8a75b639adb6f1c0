"""The text in front of Prophesee RAW data: which format, which sensor.

Leading lines that begin with ``%``; newer files end them with ``% end``, older ones just go over into binary data. The
format is in ``% format EVT3;height=720;width=1280`` or ``% evt 3.0``, the geometry there or in ``% geometry 1280x720``.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import StrEnum

import numpy as np

from motiondlo.errors import RecordingError
from motiondlo.events.types import SensorGeometry

MAX_HEADER_BYTES = 1 << 16
_MAX_SIDE_PX = 2048
_EXPORT = "Export the recording as EVT3, EVT2 or EVT2.1 RAW."


class EventFormat(StrEnum):
    """Encodings that can be decoded."""

    EVT2 = "EVT2"
    EVT21 = "EVT2.1"
    EVT3 = "EVT3"


_EVT21_TYPES = (0x0, 0x1, 0x8, 0xA, 0xE, 0xF)
_BY_NAME = {
    "EVT3": EventFormat.EVT3,
    "EVT2": EventFormat.EVT2,
    "EVT21": EventFormat.EVT21,
    "3.0": EventFormat.EVT3,
    "2.0": EventFormat.EVT2,
    "2.1": EventFormat.EVT21,
}


@dataclass(frozen=True)
class RawHeader:
    """What the header says, and where the data begin."""

    format: EventFormat
    geometry: SensorGeometry | None
    """None where the header does not tell."""
    size_bytes: int
    swapped_halves: bool = False
    """EVT2.1 only: the upper half of every 64-bit word comes first."""
    fields: Mapping[str, str] = field(default_factory=dict)
    """Every ``% key value`` line."""


def parse_raw_header(data: bytes, source: str = "events") -> RawHeader:
    """Parse the header at the start of ``data`` (the first MAX_HEADER_BYTES of a file suffice).

    source: name for error messages. Raises RecordingError when there is no header, or its format is none of ours.
    """
    lines, size = _header_lines(data)
    fields = {}
    for line in lines:
        key, _, value = line.partition(" ")
        fields[key.lower()] = value.strip()
    name, options = _format_of(fields)
    if not lines or not name:
        raise RecordingError(f"{source}: is no Prophesee RAW file (its header names no EVT format).", _EXPORT)
    if name not in _BY_NAME:
        raise RecordingError(f"{source}: its format {name} is not supported.", _EXPORT)
    return RawHeader(
        format=_BY_NAME[name],
        geometry=_geometry_of(fields, options),
        size_bytes=size,
        swapped_halves=_halves_are_swapped(options, data[size:]) if _BY_NAME[name] is EventFormat.EVT21 else False,
        fields=fields,
    )


def _header_lines(data: bytes) -> tuple[list[str], int]:
    """Lines without ``% ``, and the size of all of them in bytes.

    Binary data may begin with the byte of ``%`` too: a header line starts with ``% `` and is printable.
    """
    lines = []
    at = 0
    while data[at : at + 2] == b"% " and at < MAX_HEADER_BYTES:
        stop = data.find(b"\n", at)
        line = data[at + 2 : stop].rstrip(b"\r")
        if stop < 0 or not all(0x20 <= byte < 0x7F or byte >= 0x80 or byte == 0x09 for byte in line):
            break
        at = stop + 1
        if line.strip().lower() == b"end":
            break
        lines.append(line.decode("utf-8", errors="replace").strip())
    return lines, at


def _format_of(fields: Mapping[str, str]) -> tuple[str, dict[str, str]]:
    if fields.get("format"):
        name, *rest = fields["format"].split(";")
        options = dict(part.strip().lower().split("=", 1) for part in rest if "=" in part)
        return name.strip().upper().replace("EVT2.1", "EVT21"), options
    return fields.get("evt", ""), {}


def _halves_are_swapped(options: Mapping[str, str], start: bytes) -> bool:
    """EVT2.1: what the header says, or in which half of the first words the types are all known ones."""
    if "endianness" in options:
        return options["endianness"] == "legacy"
    halves = np.frombuffer(start[: len(start) // 8 * 8], "<u4").reshape(-1, 2)
    known = np.isin(halves >> 28, _EVT21_TYPES).sum(axis=0)
    return bool(known[0] > known[1])


def _geometry_of(fields: Mapping[str, str], options: Mapping[str, str]) -> SensorGeometry | None:
    found = re.fullmatch(r"(\d{1,5})\s*x\s*(\d{1,5})", fields.get("geometry", ""))
    width, height = found.groups() if found else (options.get("width", ""), options.get("height", ""))
    if not (re.fullmatch(r"\d{1,5}", width) and re.fullmatch(r"\d{1,5}", height)):
        return None
    if not (0 < int(width) <= _MAX_SIDE_PX and 0 < int(height) <= _MAX_SIDE_PX):
        return None
    return SensorGeometry(int(width), int(height))
