"""Bad messages are refused with their reason and sender, whatever is wrong with them."""

from __future__ import annotations

import contextlib
import copy
import math
from typing import Any

import msgpack
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from tests.common.messages.examples import EXPECT, NOW_NS, STAMP, all_messages, batch, events, update

from motiondlo.messages.events import EventBatchMessage
from motiondlo.messages.header import INT_MAX, Message
from motiondlo.messages.reject import Expectation, Rejected
from motiondlo.messages.track import TrackMessage
from motiondlo.rejects import RejectReason as Reason

ALL = all_messages()


def wire_map(name: str) -> dict[str, Any]:
    """The decoded map of the example called ``name``, to be damaged."""
    data: dict[str, Any] = msgpack.unpackb(ALL[name].to_bytes(STAMP))
    return data


def refusal(name: str, data: object, expect: Expectation = EXPECT) -> Rejected:
    """How the message's reader refuses ``data``."""
    with pytest.raises(Rejected) as caught:
        type(ALL[name]).from_bytes(data if isinstance(data, bytes) else msgpack.packb(data), expect)
    return caught.value


def with_value(name: str, path: tuple[str | int, ...], value: object) -> dict[str, Any]:
    """The example's map with one value replaced."""
    data = wire_map(name)
    place: Any = data
    for step in path[:-1]:
        place = place[step]
    place[path[-1]] = value
    return data


def f8(*values: float, shape: tuple[int, ...]) -> dict[str, Any]:
    """The wire map of an f8 array."""
    return {"dtype": "<f8", "shape": shape, "data": np.array(values, "<f8").tobytes()}


@pytest.mark.parametrize("name", sorted(ALL))
@pytest.mark.parametrize(
    ("key", "value", "reason"),
    [
        ("schema", 2, Reason.SCHEMA_TOO_NEW),
        ("schema", 0, Reason.SCHEMA_INVALID),
        ("schema", "1", Reason.SCHEMA_INVALID),
        ("schema", True, Reason.SCHEMA_INVALID),
        ("cell", "cell2", Reason.FOREIGN_CELL),
        ("cell", "a/b", Reason.SCHEMA_INVALID),
        ("cell", 1, Reason.SCHEMA_INVALID),
        ("seq", -1, Reason.SCHEMA_INVALID),
        ("seq", 1.0, Reason.SCHEMA_INVALID),
        ("t_us", INT_MAX + 1, Reason.SCHEMA_INVALID),
        ("t_us", 3_000_001, Reason.FUTURE_TIME),
        ("t_sent_ns", NOW_NS + 2_000_000, Reason.FUTURE_TIME),
        ("t_sent_ns", None, Reason.SCHEMA_INVALID),
    ],
)
def test_a_bad_header_is_refused_by_every_reader(name: str, key: str, value: object, reason: Reason) -> None:
    rejected = refusal(name, with_value(name, (key,), value))
    assert rejected.reason is reason
    assert rejected.sender == ("" if name == "state" else "sender")


@pytest.mark.parametrize("name", sorted(ALL))
@pytest.mark.parametrize("key", ["schema", "seq", "cell", "t_us", "t_sent_ns"])
def test_a_header_with_a_key_missing_is_refused(name: str, key: str) -> None:
    data = wire_map(name)
    del data[key]
    assert refusal(name, data).reason is Reason.SCHEMA_INVALID


@pytest.mark.parametrize(
    ("name", "path", "value", "reason"),
    [
        ("track", ("dlos", 0, "nodes"), f8(1, 2, math.nan, 4, shape=(2, 2)), Reason.NOT_FINITE),
        ("track", ("dlos", 0, "nodes"), f8(1, 2, math.inf, -math.inf, shape=(2, 2)), Reason.NOT_FINITE),
        ("track", ("dlos", 0, "nodes"), f8(1, 2, 3, 4, shape=(2, 2)), Reason.WRONG_SHAPE),
        ("track", ("dlos", 0, "nodes"), f8(1, 2, 3, 4, shape=(4,)), Reason.WRONG_SHAPE),
        ("track", ("dlos", 0, "nodes"), f8(1, 2, 3, shape=(2, 2)), Reason.WRONG_SHAPE),
        ("track", ("dlos", 0, "nodes"), f8(shape=(-1, 2)), Reason.WRONG_SHAPE),
        ("track", ("dlos", 0, "nodes"), f8(shape=(2000, 2)), Reason.TOO_LARGE),
        ("track", ("dlos", 0, "nodes"), [[1.0, 2.0]], Reason.SCHEMA_INVALID),
        ("track", ("dlos", 0, "nodes", "dtype"), "<f4", Reason.SCHEMA_INVALID),
        ("track", ("dlos", 0, "nodes", "dtype"), [["a", "<f8"]], Reason.SCHEMA_INVALID),
        ("track", ("dlos", 0, "nodes", "data"), "text", Reason.SCHEMA_INVALID),
        ("track", ("dlos", 0, "confidence"), math.nan, Reason.NOT_FINITE),
        ("track", ("dlos", 0, "confidence"), 1.5, Reason.SCHEMA_INVALID),
        ("track", ("dlos", 0, "source"), "guess", Reason.SCHEMA_INVALID),
        ("track", ("dlos", 0, "moving"), 1, Reason.SCHEMA_INVALID),
        ("track", ("dlos",), [wire_map("track")["dlos"][0]] * 65, Reason.TOO_LARGE),
        ("track", ("t_ingest_ns",), NOW_NS + 2_000_000, Reason.FUTURE_TIME),
        ("track", ("source",), "no/name", Reason.SCHEMA_INVALID),
        ("track", ("rejects",), {"too_old": -1}, Reason.SCHEMA_INVALID),
        ("state", ("mode",), "IDLE", Reason.SCHEMA_INVALID),
        ("state", ("dlos", 0, "nodes_mm"), f8(1, 2, shape=(1, 2)), Reason.SCHEMA_INVALID),
        ("state", ("dlos", 0, "visible"), {"dtype": "|u1", "shape": [1], "data": b"\1"}, Reason.WRONG_SHAPE),
        ("events_batch", ("n",), 3, Reason.WRONG_SHAPE),
        ("events_batch", ("t1_us",), 1_000_000, Reason.TIME_BACKWARDS),
        ("events_batch", ("t1_us",), 1_000_900, Reason.TIME_BACKWARDS),
        ("events_batch", ("t0_us",), 1_000_001, Reason.TIME_BACKWARDS),
        ("events_batch", ("width_px",), 3, Reason.OUT_OF_SENSOR),
        ("events_batch", ("height_px",), 3, Reason.OUT_OF_SENSOR),
        ("events_batch", ("events", "dtype"), "<u8", Reason.SCHEMA_INVALID),
        ("events_batch", ("events", "shape"), [5], Reason.WRONG_SHAPE),
        ("frame", ("image", "shape"), [4, 18, 1], Reason.WRONG_SHAPE),
        ("frame", ("channels",), "hsv", Reason.SCHEMA_INVALID),
        ("correction", ("kind",), "delete", Reason.SCHEMA_INVALID),
        ("correction", ("sigma_normal_px",), f8(1, shape=(1,)), Reason.WRONG_SHAPE),
        ("correction", ("appearance", "known", "shape"), [9, 2], Reason.WRONG_SHAPE),
        ("correction", ("ends",), ["tip"], Reason.SCHEMA_INVALID),
        ("segmentation", ("instances", 0, "score"), -0.1, Reason.SCHEMA_INVALID),
        ("health", ("uptime_s",), math.inf, Reason.NOT_FINITE),
        ("health", ("problems",), ["x" * 1001], Reason.TOO_LARGE),
        ("command_request", ("verb",), "explode", Reason.SCHEMA_INVALID),
        ("events_clock", ("drift_ppm",), math.nan, Reason.NOT_FINITE),
    ],
)
def test_bad_content_is_refused(name: str, path: tuple[str | int, ...], value: object, reason: Reason) -> None:
    assert refusal(name, with_value(name, path, value)).reason is reason


@pytest.mark.parametrize(
    ("field", "value", "reason"),
    [
        ("t", 999_999, Reason.TIME_BACKWARDS),
        ("t", 1_000_000, Reason.TIME_BACKWARDS),
        ("x", 1280, Reason.OUT_OF_SENSOR),
        ("y", 720, Reason.OUT_OF_SENSOR),
        ("p", 2, Reason.OUT_OF_SENSOR),
    ],
)
def test_one_bad_event_condemns_its_batch(field: str, value: int, reason: Reason) -> None:
    sent = batch()
    sent.events[field][2] = value
    with pytest.raises(Rejected) as caught:
        EventBatchMessage.from_bytes(EventBatchMessage.from_batch(sent, 0).to_bytes(STAMP), EXPECT)
    assert caught.value.reason is reason


def numpy_verdict(array: np.ndarray, t0_us: int, t1_us: int, width_px: int, height_px: int) -> bool:
    """The plain twin of the compiled check of events."""
    t_us = array["t"]
    in_time = bool(((t_us >= t0_us) & (t_us < t1_us)).all() and (np.diff(t_us) >= 0).all())
    return in_time and bool(((array["x"] < width_px) & (array["y"] < height_px) & (array["p"] <= 1)).all())


@given(
    rows=st.lists(
        st.tuples(st.integers(-3, 12), st.integers(0, 5), st.integers(0, 5), st.integers(0, 2)), min_size=0, max_size=8
    ),
    ordered=st.booleans(),
)
@settings(max_examples=200, deadline=None)
def test_the_compiled_check_agrees_with_numpy(rows: list[tuple[int, int, int, int]], ordered: bool) -> None:
    array = events(len(rows))
    for i, row in enumerate(sorted(rows) if ordered else rows):
        array[i] = row
    sent = EventBatchMessage.from_batch(type(batch())(0, 10, array), 0, width_px=5, height_px=4)
    try:
        EventBatchMessage.from_bytes(sent.to_bytes(STAMP), EXPECT)
        accepted = True
    except Rejected:
        accepted = False
    assert accepted == numpy_verdict(array, 0, 10, 5, 4)


@pytest.mark.parametrize(
    "payload",
    [b"", b"\xc1", b"\x81\xa1a", b"{}", b"\xdf\xff\xff\xff\xff", b"\x91" * 2000, b"\x81\xc0\x01", b"\x81\xa1\xff\x01"],
)
@pytest.mark.parametrize("name", ["track", "events_batch"])
def test_what_is_no_msgpack_is_refused(name: str, payload: bytes) -> None:
    assert refusal(name, payload).reason in (Reason.NOT_MSGPACK, Reason.SCHEMA_INVALID)


@pytest.mark.parametrize("payload", [b"\x01", b"\x90", b"\xc0"])
def test_what_is_no_map_is_refused(payload: bytes) -> None:
    assert refusal("track", payload).reason is Reason.SCHEMA_INVALID


def test_a_payload_beyond_the_topics_bound_is_not_even_parsed() -> None:
    expect = Expectation(cell="cell1", max_payload_bytes=100)
    assert refusal("track", b"\xc1" * 101, expect).reason is Reason.TOO_LARGE


def test_the_newer_schema_is_what_counts_however_foreign_the_rest() -> None:
    assert refusal("track", {"schema": 9, "everything": "else"}).reason is Reason.SCHEMA_TOO_NEW


@given(payload=st.binary(max_size=300))
@settings(max_examples=200, deadline=None)
def test_noise_is_refused_and_never_more_than_that(payload: bytes) -> None:
    for model in (TrackMessage, EventBatchMessage):
        with pytest.raises(Rejected):
            model.from_bytes(payload, EXPECT)


@given(cut=st.integers(0, 10_000), flip=st.integers(0, 255), name=st.sampled_from(sorted(ALL)))
@settings(max_examples=300, deadline=None)
def test_a_damaged_payload_is_read_or_refused_and_never_more_than_that(cut: int, flip: int, name: str) -> None:
    payload = bytearray(ALL[name].to_bytes(STAMP))
    payload[cut % len(payload)] ^= flip
    for damaged in (bytes(payload), bytes(payload[: cut % len(payload)])):
        try:
            message = type(ALL[name]).from_bytes(damaged, EXPECT)
        except Rejected:
            continue
        assert isinstance(message, Message)


leaf = (
    st.none()
    | st.booleans()
    | st.integers(-(2**63), 2**64 - 1)
    | st.floats()
    | st.text(max_size=5)
    | st.binary(max_size=5)
)
anything = st.recursive(
    leaf, lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=5), inner, max_size=3)
)


@given(data=st.data(), name=st.sampled_from(sorted(ALL)), value=anything)
@settings(max_examples=300, deadline=None)
def test_any_value_in_any_place_is_read_or_refused(data: st.DataObject, name: str, value: object) -> None:
    damaged = copy.deepcopy(wire_map(name))
    place: Any = damaged
    while True:
        keys = list(place) if isinstance(place, dict) else list(range(len(place)))
        key = data.draw(st.sampled_from(keys))
        if isinstance(place[key], dict | list) and place[key] and data.draw(st.booleans()):
            place = place[key]
            continue
        place[key] = value
        break
    with contextlib.suppress(Rejected):
        type(ALL[name]).from_bytes(msgpack.packb(damaged), EXPECT)


def test_the_event_horizon_is_optional() -> None:
    late = TrackMessage.from_update(update(), 0).to_bytes(STAMP)
    assert TrackMessage.from_bytes(late, Expectation(cell="cell1")).t_us == 1_001_000
