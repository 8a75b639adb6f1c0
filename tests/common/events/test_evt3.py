"""EVT3 decoding: sound streams, chunk boundaries, wraps, and every kind of damage."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from tests.common.events.encoding import decode, make_events, make_triggers, plain_evt3, random_events, words16

from motiondlo.events.evt3 import Evt3Decoder
from motiondlo.events.joining import join
from motiondlo.events.types import EventArray, SensorGeometry
from motiondlo.events.writer import Evt3Encoder

SENSOR = SensorGeometry()
HIGH, LOW, ROW, X_ON, BASE, V12, V8 = 0x8000, 0x6000, 0x0000, 0x2800, 0x3000, 0x4000, 0x5000


def encoded(events: EventArray, geometry: SensorGeometry = SENSOR) -> bytes:
    return Evt3Encoder(geometry).encode(events)


def missing_and_made_up(true: EventArray, got: EventArray) -> tuple[int, int]:
    """How many true events are missing, and how many were given that do not exist."""
    true_set = set(map(tuple, true.tolist()))
    got_set = set(map(tuple, got.tolist()))
    return len(true_set - got_set), len(got_set - true_set)


def test_words_of_every_kind() -> None:
    data = words16(
        [
            HIGH | 1, LOW | 5, ROW | 7, X_ON | 100, 0x2000 | 101,
            0xA301, LOW | 6, BASE | 0x800 | 30, V12 | 0b1000_0000_0001, V12 | 1, V8 | 0b1000_0000,
            0xE014, 0x7001, 0xF002, 0xD000, LOW | 9, ROW | 0x800 | 8, X_ON | 1,
        ]
    )  # fmt: skip
    events, triggers = decode(Evt3Decoder(SENSOR), data)
    t = 4096
    assert events.tolist() == [
        (t + 5, 100, 7, 1), (t + 5, 101, 7, 0),
        (t + 6, 30, 7, 1), (t + 6, 41, 7, 1), (t + 6, 42, 7, 1), (t + 6, 61, 7, 1),
        (t + 9, 1, 8, 1),
    ]  # fmt: skip
    assert triggers.tolist() == [(t + 5, 3, 1)]


def test_time_low_restarts_with_a_new_time_high_and_stays_with_a_repeated_one() -> None:
    data = words16([HIGH, LOW | 9, ROW, X_ON, HIGH, X_ON | 1, HIGH | 1, X_ON | 2])
    events, _ = decode(Evt3Decoder(SENSOR), data)
    assert events["t"].tolist() == [9, 9, 4096]


def test_everything_before_the_first_time_high_is_skipped_and_counted() -> None:
    data = words16([LOW | 9, ROW | 3, X_ON | 1, X_ON | 2, 0xA001, HIGH | 2, LOW | 1, ROW | 3, X_ON | 3])
    decoder = Evt3Decoder(SENSOR)
    events, triggers = decode(decoder, data)
    assert events.tolist() == [(8193, 3, 3, 1)]
    assert len(triggers) == 0
    assert decoder.damage == {"words_before_first_time": 3}


def test_agrees_with_the_plain_decoder() -> None:
    rng = np.random.default_rng(3)
    events = random_events(5000, seed=3, mean_step_us=0.3)
    burst = np.zeros(600, events.dtype)
    burst["t"], burst["y"], burst["x"], burst["p"] = events["t"][-1] + 5, 9, np.arange(600) * 2 + 1, 1
    events = join([events, burst])
    triggers = make_triggers((int(t), 0, i % 2) for i, t in enumerate(np.sort(rng.choice(events["t"], 40))))
    data = Evt3Encoder(SENSOR).encode(events, triggers)
    decoder = Evt3Decoder(SENSOR)
    got, got_triggers = decode(decoder, data)
    plain, plain_triggers = plain_evt3(data)
    np.testing.assert_array_equal(got, plain)
    np.testing.assert_array_equal(got, events)
    np.testing.assert_array_equal(got_triggers, plain_triggers)
    np.testing.assert_array_equal(got_triggers, triggers)
    assert decoder.damage == {}


def test_24_bit_wraps_are_unrolled() -> None:
    lap_us = 1 << 24
    times = [lap_us - 5000, lap_us - 3, lap_us + 2, lap_us + 9000, 2 * lap_us + 1, 3 * lap_us + 70]
    events = make_events((t, i, i, 1) for i, t in enumerate(times))
    decoder = Evt3Decoder(SENSOR)
    got, _ = decode(decoder, encoded(events))
    assert got["t"].tolist() == times
    assert decoder.marks["wraps"] == 3
    assert decoder.damage == {}


def test_a_wrap_within_a_gap_of_the_time_words() -> None:
    data = words16([HIGH | 4000, LOW, ROW, X_ON, HIGH | 50, LOW, X_ON, HIGH | 51, LOW, X_ON])
    decoder = Evt3Decoder(SENSOR)
    events, _ = decode(decoder, data)
    assert events["t"].tolist() == [4000 << 12, (4096 + 50) << 12, (4096 + 51) << 12]
    assert decoder.marks == {"wraps": 1, "gaps": 1}
    assert decoder.damage == {}


def test_long_silence_without_time_words_is_a_gap_not_damage() -> None:
    data = words16([HIGH, LOW | 1, ROW, X_ON, HIGH | 1000, LOW | 2, X_ON])
    decoder = Evt3Decoder(SENSOR)
    events, _ = decode(decoder, data)
    assert events["t"].tolist() == [1, (1000 << 12) + 2]
    assert decoder.marks["gaps"] == 1
    assert decoder.damage == {}


def test_events_outside_the_sensor_are_dropped_and_counted() -> None:
    data = words16(
        [
            HIGH, LOW | 1, ROW | 479, X_ON | 639, X_ON | 640, X_ON | 2047, ROW | 480, X_ON | 3,
            ROW | 5, BASE | 632, V12 | 0xFFF, V12 | 0xFFF, V8 | 0xFF, X_ON | 4,
        ]
    )  # fmt: skip
    decoder = Evt3Decoder(SensorGeometry(640, 480))
    events, _ = decode(decoder, data)
    assert events["x"].tolist() == [639, *range(632, 640), 4]
    assert decoder.damage == {"out_of_sensor": 3 + 24}


def test_an_odd_last_byte_is_counted() -> None:
    events = random_events(100)
    decoder = Evt3Decoder(SENSOR)
    got, _ = decode(decoder, encoded(events) + b"\x12")
    np.testing.assert_array_equal(got, events)
    assert decoder.damage == {"truncated_bytes": 1}


def test_TRUNCATED_keeps_all_events_before_the_end() -> None:
    events = random_events(3000)
    data = encoded(events)
    got, _ = decode(Evt3Decoder(SENSOR), data[: len(data) * 2 // 3])
    plain, _ = plain_evt3(data[: len(data) * 2 // 3])
    assert len(plain) > 1900
    np.testing.assert_array_equal(got, plain)


@pytest.mark.parametrize("reserved", [0x1000, 0x9ABC, 0xB000, 0xCFFF])
def test_ONE_RESERVED_WORD_costs_only_what_follows_until_the_next_time_word(reserved: int) -> None:
    events = random_events(4000, mean_step_us=3.0)
    words = np.frombuffer(encoded(events), "<u2").copy()
    at = len(words) // 2
    before, _ = plain_evt3(words[:at].tobytes())
    words[at] = reserved
    decoder = Evt3Decoder(SENSOR)
    got, _ = decode(decoder, words.tobytes())
    np.testing.assert_array_equal(got[: len(before)], before)
    missing, made_up = missing_and_made_up(events, got)
    assert made_up == 0
    assert missing <= 20
    assert decoder.damage["reserved_word"] == 1
    assert decoder.damage["skipped_bytes"] == 2


def test_LOST_TIME_HIGH_never_gives_a_wrong_time() -> None:
    events = random_events(20_000, mean_step_us=2.0)
    words = np.frombuffer(encoded(events), "<u2").copy()
    at = np.flatnonzero(words >> 12 == 8)[4]
    words[at] = 0x1000
    got, _ = decode(Evt3Decoder(SENSOR), words.tobytes())
    missing, made_up = missing_and_made_up(events, got)
    assert made_up == 0
    assert missing <= 2200  # the rest of that time high's 4096 us


def test_MADE_UP_TIME_WORDS_do_not_reach_the_output() -> None:
    events = random_events(20_000, mean_step_us=2.0)
    clean = np.frombuffer(encoded(events), "<u2")
    for word in (HIGH | 3000, HIGH | 20, LOW | 4095, LOW | 0):
        words = clean.copy()
        at = np.flatnonzero(words >> 12 == 2)[5000]
        words[at] = word
        decoder = Evt3Decoder(SENSOR)
        got, _ = decode(decoder, words.tobytes())
        missing, made_up = missing_and_made_up(events, got)
        assert made_up == 0, hex(word)
        assert missing <= 2500, hex(word)
        assert decoder.damage["time_outlier"] == 1, hex(word)


@pytest.mark.parametrize("fill", [b"\x00", b"\xff"])
def test_HOLE_filled_with_one_value(fill: bytes) -> None:
    events = random_events(20_000, mean_step_us=2.0)
    data = encoded(events)
    at = len(data) // 2 // 2 * 2
    holed = data[:at] + fill * 4096 + data[at + 4096 :]
    decoder = Evt3Decoder(SENSOR)
    got, _ = decode(decoder, holed)
    missing, made_up = missing_and_made_up(events, got)
    assert made_up == 0
    assert missing <= 1000 + 2500
    assert decoder.damage["repeated_word"] == 1
    assert decoder.damage["skipped_bytes"] == pytest.approx(4096, abs=24)


@pytest.mark.parametrize("lost", [1, 3, 101])
def test_ODD_NUMBER_OF_BYTES_LOST_is_realigned(lost: int) -> None:
    events = random_events(20_000, mean_step_us=2.0)
    data = encoded(events)
    at = len(data) // 2
    decoder = Evt3Decoder(SENSOR)
    got, _ = decode(decoder, data[:at] + data[at + lost :])
    missing, made_up = missing_and_made_up(events, got)
    assert decoder.damage["realigned"] == 1
    assert missing <= 2600
    assert made_up <= 6  # words read across the cut, before one shows that it is damage
    assert got["t"].max() == events["t"].max()


@pytest.mark.parametrize("seed", range(5))
def test_GARBAGE_in_the_middle(seed: int) -> None:
    events = random_events(30_000, seed=seed, mean_step_us=2.0)
    data = encoded(events)
    at = len(data) // 3 + seed
    garbage = np.random.default_rng(seed).integers(0, 256, 5001).astype(np.uint8).tobytes()
    decoder = Evt3Decoder(SENSOR)
    got, _ = decode(decoder, data[:at] + garbage + data[at:])
    before, _ = plain_evt3(data[: at // 2 * 2])
    np.testing.assert_array_equal(got[: len(before)], before)
    missing, made_up = missing_and_made_up(events, got)
    assert missing <= 2600
    assert made_up <= 6
    assert (np.diff(got["t"]) >= 0).all()
    assert got["t"].max() == events["t"].max()


def test_CLOCK_STEPS_BACK_is_bridged() -> None:
    events = random_events(20_000, mean_step_us=2.0)
    events["t"] += 3_000_000
    restarted = random_events(20_000, seed=1, mean_step_us=2.0)
    decoder = Evt3Decoder(SENSOR)
    got, _ = decode(decoder, encoded(events) + encoded(restarted))
    assert decoder.damage["time_backwards"] == 1
    np.testing.assert_array_equal(got[:20_000], events)
    assert len(got) == 40_000
    assert (np.diff(got["t"]) >= 0).all()
    np.testing.assert_array_equal(np.diff(got["t"][20_000:]), np.diff(restarted["t"]))


def test_markers_a_few_microseconds_out_of_order_are_no_damage() -> None:
    """A 1 kHz time marker may come some microseconds before data that are slightly older."""
    data = words16([HIGH, LOW | 795, ROW, X_ON, HIGH, LOW | 811, LOW | 800, ROW | 1, X_ON, HIGH, LOW | 820, X_ON])
    decoder = Evt3Decoder(SENSOR)
    events, _ = decode(decoder, data)
    assert events["t"].tolist() == [795, 800, 820]
    assert decoder.damage == {}


def test_endless_events_without_a_time_word_are_given_out_in_bounded_pieces() -> None:
    data = words16([HIGH, LOW | 1, ROW]) + words16([X_ON | 5]) * 700_000
    decoder = Evt3Decoder(SENSOR)
    events, _ = decoder.push(data)
    assert 500_000 < len(events) <= 700_000
    assert (events["t"] == 1).all()
    rest, _ = decoder.flush()
    assert len(events) + len(rest) == 700_000


def test_time_goes_on_in_silence() -> None:
    decoder = Evt3Decoder(SENSOR)
    assert decoder.time_us == -1
    decoder.push(words16([HIGH, LOW | 3, ROW, X_ON]))
    decoder.push(words16(HIGH | i for i in range(1, 300)))
    assert decoder.time_us > 1_200_000 - 4096 * 8


BYTES = st.binary(max_size=600)
WORDS = st.lists(st.integers(0, 0xFFFF), max_size=300).map(words16)
LIKELY = st.sampled_from(
    [HIGH, HIGH | 1, HIGH | 2, HIGH | 4095, LOW, LOW | 7, LOW | 4000, ROW | 1, X_ON | 2, BASE, V12]
)
STREAMS = BYTES | WORDS | st.lists(LIKELY | st.integers(0, 0xFFFF), max_size=300).map(words16)


@settings(max_examples=200, deadline=None)
@given(st.lists(STREAMS, min_size=1, max_size=4), st.integers(1, 97))
def test_FUZZ_never_crashes_never_goes_back_and_ignores_chunk_boundaries(parts: list[bytes], chunk: int) -> None:
    sound = encoded(random_events(60, mean_step_us=40.0))
    data = sound.join(parts)
    whole = Evt3Decoder(SENSOR)
    events, triggers = decode(whole, data)
    assert (np.diff(events["t"]) >= 0).all()
    assert (np.diff(triggers["t"]) >= 0).all()
    assert not len(events) or (events["x"].max() < 1280 and events["y"].max() < 720 and events["t"].min() >= 0)
    pieces = Evt3Decoder(SENSOR)
    events_in_pieces, triggers_in_pieces = decode(pieces, data, chunk)
    np.testing.assert_array_equal(events_in_pieces, events)
    np.testing.assert_array_equal(triggers_in_pieces, triggers)
    assert pieces.damage == whole.damage


def test_what_was_promised_by_time_us_holds() -> None:
    """No event is older than the time that the decoder had announced before it gave the event out."""
    data = encoded(random_events(3000, mean_step_us=9.0)) + np.random.default_rng(0).bytes(3000)
    data += encoded(random_events(3000, seed=4, mean_step_us=9.0))
    decoder = Evt3Decoder(SENSOR)
    announced = -1
    for i in range(0, len(data), 50):
        events, triggers = decoder.push(data[i : i + 50])
        for part in (events, triggers):
            assert not len(part) or part["t"][0] >= announced
        assert decoder.time_us >= announced
        announced = decoder.time_us


def test_time_that_is_told_without_events_goes_on_without_damage_and_wraps() -> None:
    encoder, decoder = Evt3Encoder(SENSOR), Evt3Decoder(SENSOR)
    decoder.push(encoder.encode(make_events([(5000, 1, 2, 1)])))
    for t_us in range(6000, 40_000_000, 4000):
        decoder.push(encoder.tell_time(t_us))
        assert t_us - 8192 <= decoder.time_us <= t_us
    events = join([decoder.push(encoder.encode(make_events([(40_000_123, 3, 4, 0)])))[0], decoder.flush()[0]])
    assert events["t"].tolist() == [40_000_123]
    assert not any(decoder.damage.values())
    with pytest.raises(ValueError, match="decrease"):
        encoder.tell_time(1)
