"""EVT2 and EVT2.1 decoding: sound streams, chunk boundaries, wraps and damage."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from tests.common.events.encoding import decode, make_events, make_triggers, plain_evt2_words, plain_evt21_words
from tests.common.events.encoding import random_events as random_events_of

from motiondlo.events.evt2 import Evt2Decoder, Evt21Decoder
from motiondlo.events.stream_decoder import StreamDecoder
from motiondlo.events.types import SensorGeometry, empty_triggers

SENSOR = SensorGeometry(640, 480)
TIME_HIGH = 0x8 << 28


def random_events(n: int, seed: int = 0, mean_step_us: float = 2.0) -> np.ndarray:
    return random_events_of(n, seed, mean_step_us, SENSOR.width_px, SENSOR.height_px)


def words32(*words: int) -> bytes:
    return np.array(words, "<u4").tobytes()


def test_evt2_agrees_with_what_was_encoded() -> None:
    events = random_events(3000)
    triggers = make_triggers((int(t), 3, i % 2) for i, t in enumerate(events["t"][::500]))
    decoder = Evt2Decoder(SENSOR)
    got, got_triggers = decode(decoder, plain_evt2_words(events, triggers))
    np.testing.assert_array_equal(got, events)
    np.testing.assert_array_equal(got_triggers, triggers)
    assert decoder.damage == {}


@pytest.mark.parametrize("swapped", [False, True])
def test_evt21_agrees_with_what_was_encoded(swapped: bool) -> None:
    events = random_events(3000)
    decoder = Evt21Decoder(SENSOR, swapped)
    got, _ = decode(decoder, plain_evt21_words(events, swapped), chunk=1001)
    np.testing.assert_array_equal(got, events)
    assert decoder.damage == {}


def test_evt21_vectors_beyond_the_right_border() -> None:
    data = words32(0, TIME_HIGH | 2, 0xFFFFFFFF, 1 << 28 | 5 << 22 | 624 << 11 | 7)
    decoder = Evt21Decoder(SENSOR)
    got, _ = decode(decoder, data)
    assert got.tolist() == [(133, x, 7, 1) for x in range(624, 640)]
    assert decoder.damage == {"out_of_sensor": 16}


def test_evt21_triggers() -> None:
    got, triggers = decode(Evt21Decoder(SENSOR), words32(0, TIME_HIGH | 1, 0, 0xA << 28 | 9 << 22 | 2 << 8 | 1))
    assert len(got) == 0
    assert triggers.tolist() == [(73, 2, 1)]


def test_34_bit_wrap_is_unrolled() -> None:
    lap_us = 1 << 34
    events = make_events([(lap_us - 70, 1, 1, 1), (lap_us - 1, 2, 1, 1), (lap_us + 3, 3, 1, 0), (lap_us + 99, 4, 1, 1)])
    decoder = Evt2Decoder(SENSOR)
    got, _ = decode(decoder, plain_evt2_words(events, empty_triggers()))
    np.testing.assert_array_equal(got, events)
    assert decoder.marks["wraps"] == 1


def test_everything_before_the_first_time_high_is_skipped_and_counted() -> None:
    decoder = Evt2Decoder(SENSOR)
    got, _ = decode(decoder, words32(1 << 28, 1 << 28 | 5, TIME_HIGH | 1, 1 << 28 | 7))
    assert got.tolist() == [(64, 0, 7, 1)]
    assert decoder.damage == {"words_before_first_time": 2}


def test_ONE_RESERVED_WORD_costs_what_follows_until_the_next_time_high() -> None:
    events = random_events(4000)
    words = np.frombuffer(plain_evt2_words(events, empty_triggers()), "<u4").copy()
    words[2000] = 0x5 << 28 | 77
    decoder = Evt2Decoder(SENSOR)
    got, _ = decode(decoder, words.tobytes())
    missing = set(events.tolist()) - set(got.tolist())
    assert set(got.tolist()) <= set(events.tolist())
    assert 0 < len(missing) <= 60
    assert decoder.damage["reserved_word"] == 1


@pytest.mark.parametrize("lost", [1, 2, 3, 1002])
def test_BYTES_LOST_are_realigned(lost: int) -> None:
    events = random_events(6000)
    data = plain_evt2_words(events, empty_triggers())
    at = len(data) // 2
    decoder = Evt2Decoder(SENSOR)
    got, _ = decode(decoder, data[:at] + data[at + lost :])
    true = set(events.tolist())
    assert decoder.damage["realigned"] == 1
    assert len(true - set(got.tolist())) <= 60 + lost // 4
    assert len(set(got.tolist()) - true) <= 3
    np.testing.assert_array_equal(got[-2000:], events[-2000:])


@pytest.mark.parametrize("fill", [b"\x00", b"\xff"])
def test_HOLE_filled_with_one_value(fill: bytes) -> None:
    events = random_events(6000)
    data = plain_evt2_words(events, empty_triggers())
    decoder = Evt2Decoder(SENSOR)
    got, _ = decode(decoder, data[:8000] + fill * 2000 + data[10_000:])
    assert len(set(got.tolist()) - set(events.tolist())) <= 2
    assert len(got) > 6000 - 500 - 80
    assert decoder.damage["skipped_bytes"] == pytest.approx(2000, abs=50)


def test_MADE_UP_TIME_HIGH_does_not_reach_the_output() -> None:
    events = random_events(6000)
    words = np.frombuffer(plain_evt2_words(events, empty_triggers()), "<u4").copy()
    words[3000] = TIME_HIGH | 123_456_789
    decoder = Evt2Decoder(SENSOR)
    got, _ = decode(decoder, words.tobytes())
    assert set(got.tolist()) <= set(events.tolist())
    assert len(got) > 5900
    assert decoder.damage["time_outlier"] == 1


def test_CLOCK_STEPS_BACK_is_bridged() -> None:
    events = random_events(3000)
    events["t"] += 5_000_000
    restarted = random_events(3000, seed=1)
    decoder = Evt2Decoder(SENSOR)
    data = plain_evt2_words(events, empty_triggers()) + plain_evt2_words(restarted, empty_triggers())
    got, _ = decode(decoder, data)
    assert len(got) == 6000
    assert (np.diff(got["t"]) >= 0).all()
    assert decoder.damage == {"time_backwards": 1}


def test_an_incomplete_last_word_is_counted() -> None:
    decoder = Evt21Decoder(SENSOR)
    decode(decoder, plain_evt21_words(random_events(20)) + b"abc")
    assert decoder.damage == {"truncated_bytes": 3}


DECODERS = st.sampled_from(
    [lambda: Evt2Decoder(SENSOR), lambda: Evt21Decoder(SENSOR), lambda: Evt21Decoder(SENSOR, True)]
)


@settings(max_examples=200, deadline=None)
@given(DECODERS, st.lists(st.binary(max_size=400), min_size=1, max_size=4), st.integers(1, 97))
def test_FUZZ_never_crashes_never_goes_back_and_ignores_chunk_boundaries(
    make: type[StreamDecoder], parts: list[bytes], chunk: int
) -> None:
    sound = plain_evt2_words(random_events(40, mean_step_us=30.0), empty_triggers())
    data = sound.join(parts)
    whole, pieces = make(), make()
    events, triggers = decode(whole, data)
    assert (np.diff(events["t"]) >= 0).all()
    assert (np.diff(triggers["t"]) >= 0).all()
    assert not len(events) or (events["x"].max() < 640 and events["y"].max() < 480 and events["t"].min() >= 0)
    events_in_pieces, triggers_in_pieces = decode(pieces, data, chunk)
    np.testing.assert_array_equal(events_in_pieces, events)
    np.testing.assert_array_equal(triggers_in_pieces, triggers)
    assert pieces.damage == whole.damage
