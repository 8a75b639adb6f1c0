"""Headers of RAW files, as they are found and as they are not."""

from __future__ import annotations

import pytest
from tests.common.events.encoding import plain_evt21_words, random_events

from motiondlo.errors import RecordingError
from motiondlo.events.raw_header import EventFormat, parse_raw_header
from motiondlo.events.types import SensorGeometry


def header(*lines: str) -> bytes:
    return "".join(f"% {line}\n" for line in lines).encode()


def test_a_full_header() -> None:
    data = header("evt 3.0", "format EVT3;height=480;width=640", "geometry 640x480", "end") + b"%\x20\x0a\x80"
    parsed = parse_raw_header(data)
    assert (parsed.format, parsed.geometry) == (EventFormat.EVT3, SensorGeometry(640, 480))
    assert data[parsed.size_bytes :] == b"%\x20\x0a\x80"


def test_without_an_end_mark_the_data_begin_where_no_header_line_does() -> None:
    for binary in (b"-\x8b\x00\x60", b"%\x60\x00\x80", b"% \x00\x80\x0a", b"% \x01"):
        text = header("Date 2020-09-25 07:48:29", "evt 2.0")
        parsed = parse_raw_header(text + binary)
        assert parsed.format is EventFormat.EVT2
        assert parsed.geometry is None
        assert parsed.size_bytes == len(text)


@pytest.mark.parametrize(
    ("lines", "expected"),
    [
        (("format EVT2;width=640;height=480",), EventFormat.EVT2),
        (("format EVT21;endianness=legacy;height=720;width=1280",), EventFormat.EVT21),
        (("evt 2.1",), EventFormat.EVT21),
        (("evt 3.0",), EventFormat.EVT3),
        (("format evt3",), EventFormat.EVT3),
    ],
)
def test_where_the_format_may_stand(lines: tuple[str, ...], expected: EventFormat) -> None:
    parsed = parse_raw_header(header(*lines, "end"))
    assert parsed.format is expected
    assert parsed.swapped_halves == ("legacy" in lines[0])


@pytest.mark.parametrize("swapped", [False, True])
def test_the_order_of_halves_is_seen_in_the_data_if_the_header_does_not_tell(swapped: bool) -> None:
    data = header("evt 2.1", "end") + plain_evt21_words(random_events(300), swapped)
    assert parse_raw_header(data).swapped_halves == swapped


@pytest.mark.parametrize("geometry", ["geometry 0x480", "geometry x", "geometry 99999x3", "geometry -5x7", "geometry"])
def test_a_nonsensical_geometry_counts_as_none(geometry: str) -> None:
    assert parse_raw_header(header("evt 3.0", geometry, "end")).geometry is None


@pytest.mark.parametrize(
    "data", [b"", b"% ", b"\x00\x80\x0a\x60", b"\x89HDF\r\n", header("Date today", "end"), b"%%%%\n"]
)
def test_what_is_no_raw_file_is_named(data: bytes) -> None:
    with pytest.raises(RecordingError, match=r"some\.raw: is no Prophesee RAW file"):
        parse_raw_header(data, "some.raw")


@pytest.mark.parametrize("line", ["evt 4.0", "format EVT4;height=720;width=1280", "format HISTO3D"])
def test_an_unknown_format_is_named(line: str) -> None:
    with pytest.raises(RecordingError, match="not supported"):
        parse_raw_header(header(line, "end"))
