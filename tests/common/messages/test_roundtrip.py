"""Messages come back as they were sent; dataclasses survive the trip."""

from __future__ import annotations

import dataclasses
from enum import Enum

import msgpack
import numpy as np
import pytest
from tests.common.messages.examples import (
    EXPECT,
    NOW_NS,
    STAMP,
    all_messages,
    batch,
    correction,
    points,
    segmentation,
    state,
    update,
)

from motiondlo.events.types import EVENT_DTYPE, EventBatch, empty_events
from motiondlo.messages.correction import CorrectionMessage
from motiondlo.messages.events import ClockMessage, EventBatchMessage
from motiondlo.messages.frame import FrameMessage
from motiondlo.messages.header import Message
from motiondlo.messages.reject import ANYTHING
from motiondlo.messages.segmentation import SegmentationMessage
from motiondlo.messages.state import StateMessage
from motiondlo.messages.track import TrackMessage


def same(a: object, b: object) -> bool:
    """Equality that looks into dataclasses and arrays (values and dtypes)."""
    if isinstance(a, np.ndarray) and isinstance(b, np.ndarray):
        return a.dtype == b.dtype and a.shape == b.shape and a.tobytes() == b.tobytes()
    if dataclasses.is_dataclass(a):
        return type(a) is type(b) and all(same(getattr(a, f.name), getattr(b, f.name)) for f in dataclasses.fields(a))
    if isinstance(a, tuple) and isinstance(b, tuple):
        return len(a) == len(b) and all(same(x, y) for x, y in zip(a, b, strict=True))
    if isinstance(a, Enum):
        return a is b
    return bool(a == b)


@pytest.mark.parametrize("name", sorted(all_messages()))
def test_a_message_is_the_same_after_the_trip_and_wears_the_stamp(name: str) -> None:
    message = all_messages()[name]
    payload = message.to_bytes(STAMP)
    back = type(message).from_bytes(payload, EXPECT)
    assert (back.seq, back.cell, back.t_sent_ns) == (STAMP.seq, STAMP.cell, STAMP.t_sent_ns)
    if name != "state":
        assert back.source == STAMP.source
    assert back.to_bytes(STAMP) == payload


@pytest.mark.parametrize("name", sorted(all_messages()))
def test_any_msgpack_library_reads_the_map_with_its_header_first(name: str) -> None:
    message = all_messages()[name]
    data = msgpack.unpackb(message.to_bytes(STAMP))
    assert tuple(data)[: len(message.header_keys)] == message.header_keys


def test_a_reader_ignores_keys_that_it_does_not_know() -> None:
    data = state().wire_map(STAMP) | {"added_later": [1, 2]}
    data["dlos"][0]["also_new"] = {"a": 1}
    back = StateMessage.from_bytes(msgpack.packb(data), EXPECT)
    assert back.dlos[0].id == 3


def test_the_state_has_the_keys_of_the_contract_and_no_others() -> None:
    data = msgpack.unpackb(state().to_bytes(STAMP))
    assert set(data) == {
        *("schema", "seq", "cell", "t_us", "t_events_us", "t_sent_ns", "t_utc_ns", "t_ingest_ns", "mode", "dlos")
    }
    dlo = data["dlos"][0]
    assert set(dlo) == {
        *("id", "nodes", "sigma_px", "velocity_px_s", "visible", "diameter_px", "length_px", "confidence", "moving"),
        *("source", "t_corrected_us", "nodes_mm"),
    }
    nodes = dlo["nodes"]
    assert set(nodes) == {"dtype", "shape", "data"}
    assert nodes["dtype"] == "<f4"
    array = np.frombuffer(nodes["data"], nodes["dtype"]).reshape(nodes["shape"])
    np.testing.assert_allclose(array, points(), rtol=1e-6)
    assert (dlo["visible"]["dtype"], dlo["sigma_px"]["dtype"]) == ("|u1", "<f4")


def test_a_state_without_millimetres_says_nil() -> None:
    whole = state()
    bare = whole.model_copy(update={"dlos": (whole.dlos[0].model_copy(update={"nodes_mm": None}),)})
    assert msgpack.unpackb(bare.to_bytes(STAMP))["dlos"][0]["nodes_mm"] is None


def test_an_update_of_the_tracker_survives_bit_for_bit() -> None:
    payload = TrackMessage.from_update(update(), NOW_NS - 1, valid=False).to_bytes(STAMP)
    message = TrackMessage.from_bytes(payload, EXPECT)
    assert same(message.to_update(), update())
    assert (message.t_ingest_ns, message.valid) == (NOW_NS - 1, False)


def test_an_update_with_other_float_types_is_written_as_promised() -> None:
    track = dataclasses.replace(update().tracks[0], nodes=points().astype(np.float32), confidence=np.float32(0.5))
    sent = dataclasses.replace(update(), tracks=(track,))
    back = TrackMessage.from_bytes(TrackMessage.from_update(sent, 0).to_bytes(STAMP), EXPECT).to_update()
    assert back.tracks[0].nodes.dtype == np.float64
    np.testing.assert_array_equal(back.tracks[0].nodes, points().astype(np.float32))
    assert back.tracks[0].confidence == 0.5


def test_a_correction_survives_bit_for_bit() -> None:
    payload = CorrectionMessage.from_correction(correction()).to_bytes(STAMP)
    assert same(CorrectionMessage.from_bytes(payload, EXPECT).to_correction(), correction())


def test_a_segmentation_survives_bit_for_bit() -> None:
    payload = SegmentationMessage.from_segmentation(segmentation(), "r1").to_bytes(STAMP)
    message = SegmentationMessage.from_bytes(payload, EXPECT)
    assert same(message.to_segmentation(), segmentation())
    assert message.request_id == "r1"


def test_a_failed_segmentation_is_marked_invalid() -> None:
    failed = dataclasses.replace(segmentation(), instances=(), failure="out of memory")
    message = SegmentationMessage.from_segmentation(failed)
    assert not message.valid
    assert message.to_segmentation().failure == "out of memory"


@pytest.mark.parametrize("n", [0, 1, 4, 20_000])
def test_a_batch_survives_and_its_events_are_an_aligned_view(n: int) -> None:
    payload = EventBatchMessage.from_batch(batch(n), NOW_NS - 5).to_bytes(STAMP)
    message = EventBatchMessage.from_bytes(payload, EXPECT)
    assert same(message.to_batch(), batch(n))
    assert message.to_batch(lost_on_the_way=9).lost_before == 11
    assert message.n == n
    if n:
        assert message.events.dtype == EVENT_DTYPE
        assert payload.endswith(message.events.tobytes())
        assert (len(payload) - message.events.nbytes) % 16 == 0
        assert not message.events.flags.owndata
        assert not message.events.flags.writeable


def test_parts_are_the_payload_without_a_copy_of_the_events() -> None:
    sent = batch()
    head, tail = EventBatchMessage.from_batch(sent, 0).to_parts(STAMP)
    assert tail is not None
    assert np.shares_memory(np.frombuffer(tail, np.uint8), sent.events)
    assert head + bytes(tail) == EventBatchMessage.from_batch(sent, 0).to_bytes(STAMP)


def test_a_bulk_message_of_another_writer_is_read_too() -> None:
    data = msgpack.unpackb(EventBatchMessage.from_batch(batch(), 0).to_bytes(STAMP))
    del data["pad"]
    events_first = {"events": data.pop("events"), **data}
    events_first["triggers"] = events_first.pop("triggers")
    message = EventBatchMessage.from_bytes(msgpack.packb(events_first), EXPECT)
    assert same(message.to_batch(), batch())


def test_many_triggers_make_a_long_head_that_is_read_too() -> None:
    triggers = np.zeros(900, batch().triggers.dtype)
    sent = EventBatch(0, 1000, empty_events(3), triggers)
    message = EventBatchMessage.from_bytes(EventBatchMessage.from_batch(sent, 0).to_bytes(STAMP), EXPECT)
    assert same(message.to_batch(), sent)


def test_an_image_survives() -> None:
    sent = all_messages()["frame"]
    assert isinstance(sent, FrameMessage)
    back = FrameMessage.from_bytes(sent.to_bytes(STAMP), EXPECT)
    np.testing.assert_array_equal(back.image, sent.image)
    assert (back.name, back.trigger_id, back.reason) == ("frame_000002.jpg", 2, "request")


def test_an_image_that_is_not_contiguous_is_sent_as_it_looks() -> None:
    image = np.arange(8 * 6 * 3, dtype=np.uint8).reshape(8, 6, 3)[::2, :, ::-1]
    back = FrameMessage.from_bytes(FrameMessage(image=image).to_bytes(STAMP), EXPECT)
    np.testing.assert_array_equal(back.image, image)


def test_the_clock_maps_both_ways() -> None:
    clock = ClockMessage(anchor_us=1_000_000, anchor_host_ns=9_000_000_000, drift_ppm=50.0)
    assert clock.host_ns(1_000_000) == 9_000_000_000
    assert clock.host_ns(11_000_000) == 19_000_000_000 + 500_000
    assert clock.event_us(clock.host_ns(123_456_789)) == 123_456_789


def test_an_unstamped_message_is_readable_by_tools() -> None:
    message = all_messages()["health"]
    assert isinstance(message, Message)
    assert type(message).from_bytes(message.to_bytes(), ANYTHING).cell == "unstamped"
