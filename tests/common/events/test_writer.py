"""Encoding EVT3."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from tests.common.events.encoding import make_events, make_triggers, plain_evt3, random_events

from motiondlo.errors import RecordingError
from motiondlo.events.types import EventArray, SensorGeometry
from motiondlo.events.writer import Evt3Encoder, Evt3Writer

SENSOR = SensorGeometry()


@st.composite
def bursts(draw: st.DrawFn) -> EventArray:
    """Rows of neighbouring pixels that fire together, as edges do, with pauses."""
    rows, t_us = [], 0
    for _ in range(draw(st.integers(0, 25))):
        t_us += draw(st.sampled_from([0, 1, 40, 5000, 70_000]))
        x, y, polarity = draw(st.integers(0, 1200)), draw(st.integers(0, 719)), draw(st.integers(0, 1))
        rows += [(t_us, x + dx, y, polarity) for dx in draw(st.lists(st.integers(0, 79), max_size=40))]
    return make_events(rows)


@settings(max_examples=120, deadline=None)
@given(bursts(), st.integers(0, 1000))
def test_decodes_to_what_was_encoded_in_any_two_pieces(events: EventArray, split: int) -> None:
    encoder = Evt3Encoder(SENSOR)
    at = split % (len(events) + 1)
    data = encoder.encode(events[:at]) + encoder.encode(events[at:])
    np.testing.assert_array_equal(plain_evt3(data)[0], events)


def test_neighbours_share_vectors() -> None:
    row = make_events((100, x, 5, 1) for x in range(200, 232))
    assert len(Evt3Encoder(SENSOR).encode(row)) == 2 * (3 + 1 + 3)


def test_triggers_go_before_events_of_the_same_time() -> None:
    data = Evt3Encoder(SENSOR).encode(make_events([(7, 1, 1, 1)]), make_triggers([(7, 2, 1), (9, 2, 0)]))
    kinds = (np.frombuffer(data, "<u2") >> 12).tolist()
    assert kinds == [8, 6, 0xA, 0, 2, 6, 0xA]


def test_silence_has_all_its_time_highs() -> None:
    data = Evt3Encoder(SENSOR).encode(make_events([(0, 1, 1, 1), (20_000_000, 1, 1, 1)]))
    highs = np.frombuffer(data, "<u2") >> 12 == 8
    assert highs.sum() == (20_000_000 >> 12) + 1
    assert plain_evt3(data)[0]["t"].tolist() == [0, 20_000_000]


def test_what_cannot_be_encoded_is_refused() -> None:
    encoder = Evt3Encoder(SENSOR)
    with pytest.raises(ValueError, match="decrease"):
        encoder.encode(make_events([(5, 1, 1, 1), (4, 1, 1, 1)]))
    with pytest.raises(ValueError, match="outside"):
        encoder.encode(make_events([(5, 1280, 1, 1)]))
    encoder.encode(make_events([(5, 1, 1, 1)]))
    with pytest.raises(ValueError, match="decrease"):
        encoder.encode(make_events([(4, 1, 1, 1)]))
    with pytest.raises(ValueError, match="EVT3"):
        Evt3Encoder(SensorGeometry(4000, 720))


def test_events_that_lost_their_padding_are_encoded_alike() -> None:
    events = random_events(100)
    packed = np.concatenate([events[:50], events[50:]])
    assert packed.dtype.itemsize == 13
    assert Evt3Encoder(SENSOR).encode(packed) == Evt3Encoder(SENSOR).encode(events)


def test_a_folder_that_does_not_exist_is_named(tmp_path: Path) -> None:
    with pytest.raises(RecordingError, match="absent"):
        Evt3Writer(tmp_path / "absent" / "events.raw", SENSOR)
