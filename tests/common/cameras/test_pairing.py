"""Frames and their triggers: whatever is lost, no pair is ever shifted by one."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from motiondlo.cameras.interface import UNKNOWN, Frame
from motiondlo.cameras.pairing import FramePairing, PairedFrame, PairingParams
from motiondlo.rejects import RejectReason

PERIOD_US = 50_000
EVENT_ZERO_NS = 7_000_000_000
"""Host time at which the event clock was 0."""
DEVICE_ZERO_US = 123_456
"""Event time at which the camera's own clock was 0."""
IMAGE = np.zeros((1, 1, 3), np.uint8)


def event_us(host_ns: int) -> int:
    return (host_ns - EVENT_ZERO_NS) // 1000


def exposure_us(k: int) -> int:
    return 200_000 + k * PERIOD_US


def frame(k: int, latency_us: int, clock: bool = True, counter: bool = True, drift_ppm: float = 0.0) -> Frame:
    device_us = (exposure_us(k) - DEVICE_ZERO_US) * (1 + drift_ppm * 1e-6)
    return Frame(
        IMAGE,
        EVENT_ZERO_NS + (exposure_us(k) + latency_us) * 1000,
        counter=k if counter else UNKNOWN,
        device_ns=round(device_us * 1000) if clock else UNKNOWN,
    )


def params(max_latency_us: int = 45_000, min_latency_us: int = 5_000) -> PairingParams:
    return PairingParams(
        min_latency_us=min_latency_us, max_latency_us=max_latency_us, min_interval_us=PERIOD_US - 5_000
    )


def play(
    pairing: FramePairing, frames: list[tuple[int, Frame]], triggers: list[tuple[int, int]], until_us: int
) -> list[tuple[int, PairedFrame]]:
    """Feed both in the order in which they are told; (exposure, pair) of every pair.

    frames: (exposure, frame), told when they arrive. triggers: (exposure, delay us of being told).
    """
    pairing.on_clock(event_us)
    told = [(f.arrived_ns, 1, k, f) for k, f in frames]
    told += [(EVENT_ZERO_NS + (exposure_us(k) + delay_us) * 1000, 0, k, None) for k, delay_us in triggers]
    number = {id(f): k for k, f in frames}
    pairs = []
    for now_ns, _, k, item in sorted(told, key=lambda row: row[:3]):
        if item is None:
            pairing.on_trigger(exposure_us(k))
        else:
            pairing.on_frame(item)
        pairs += pairing.pairs(now_ns)
    pairs += pairing.pairs(EVENT_ZERO_NS + until_us * 1000)
    return [(number[id(pair.frame)], pair) for pair in pairs]


@settings(max_examples=150, deadline=None)
@given(
    data=st.data(),
    clock=st.booleans(),
    counter=st.booleans(),
    drift_ppm=st.floats(-100, 100),
    late_triggers=st.booleans(),
)
def test_RANDOM_DROPS_never_give_a_wrong_pair(
    data: st.DataObject, clock: bool, counter: bool, drift_ppm: float, late_triggers: bool
) -> None:
    n = 30
    has_frame = data.draw(st.lists(st.booleans(), min_size=n, max_size=n))
    has_trigger = data.draw(st.lists(st.booleans(), min_size=n, max_size=n))
    latency = data.draw(st.lists(st.integers(5_000, 44_000), min_size=n, max_size=n))
    delay = data.draw(st.lists(st.integers(0, 90_000 if late_triggers else 4_000), min_size=n, max_size=n))
    told_us = np.maximum.accumulate([exposure_us(k) + delay[k] for k in range(n)])
    pairing = FramePairing(params())
    frames = [(k, frame(k, latency[k], clock, counter, drift_ppm)) for k in range(n) if has_frame[k]]
    triggers = [(k, int(told_us[k]) - exposure_us(k)) for k in range(n) if has_trigger[k]]
    pairs = play(pairing, frames, triggers, exposure_us(n) + 1_000_000)
    assert all(pair.t_us == exposure_us(k) for k, pair in pairs), "a frame got another frame's trigger"
    # Every frame whose trigger exists is paired; the rest is counted.
    assert [k for k, _ in pairs] == [k for k in range(n) if has_frame[k] and has_trigger[k]]
    counts = pairing.rejects.as_dict()
    assert counts.get(RejectReason.FRAME_WITHOUT_TRIGGER.value, 0) == len(frames) - len(pairs)
    assert counts.get(RejectReason.TRIGGER_WITHOUT_FRAME.value, 0) == len(triggers) - len(pairs)


@settings(max_examples=100, deadline=None)
@given(data=st.data(), drift_ppm=st.floats(-100, 100))
def test_LATENCY_LONGER_THAN_THE_PERIOD_is_resolved_by_the_cameras_clock_or_not_at_all(
    data: st.DataObject, drift_ppm: float
) -> None:
    n = 40
    kept = data.draw(st.lists(st.tuples(st.booleans(), st.booleans()), min_size=n, max_size=n))
    latency = data.draw(st.lists(st.integers(5_000, 119_000), min_size=n, max_size=n))
    arrived = np.maximum.accumulate([exposure_us(k) + latency[k] for k in range(n)])
    pairing = FramePairing(params(max_latency_us=120_000))
    frames = [(k, frame(k, int(arrived[k]) - exposure_us(k), drift_ppm=drift_ppm)) for k in range(n) if kept[k][0]]
    pairs = play(pairing, frames, [(k, 1000) for k in range(n) if kept[k][1]], exposure_us(n) + 1_000_000)
    assert all(pair.t_us == exposure_us(k) for k, pair in pairs), "a frame got another frame's trigger"


def test_without_a_clock_a_latency_longer_than_the_period_pairs_nothing() -> None:
    pairing = FramePairing(params(max_latency_us=120_000))
    frames = [(k, frame(k, 30_000, clock=False)) for k in range(10)]
    assert play(pairing, frames, [(k, 0) for k in range(10)], exposure_us(20)) == []
    assert pairing.ambiguous == 10


def test_jitter_narrows_down_a_camera_with_a_clock() -> None:
    pairing = FramePairing(params(max_latency_us=120_000))
    latency = [100_000, 60_000, 20_000, *[30_000] * 7]
    frames = [(k, frame(k, latency[k])) for k in range(10)]
    pairs = play(pairing, frames, [(k, 0) for k in range(10)], exposure_us(20))
    assert [k for k, _ in pairs] == list(range(2, 10))
    assert all(pair.t_us == exposure_us(k) for k, pair in pairs)


def test_FRAMES_DROPPED_are_counted_by_the_cameras_own_count() -> None:
    pairing = FramePairing(params())
    frames = [(k, frame(k, 20_000)) for k in (0, 1, 4, 5)]
    pairs = play(pairing, frames, [(k, 0) for k in range(6)], exposure_us(20))
    assert [pair.trigger_id for _, pair in pairs] == [0, 1, 4, 5]
    assert pairing.frames_lost == 2


def test_a_REPEATED_frame_is_refused() -> None:
    pairing = FramePairing(params())
    pairing.on_clock(event_us)
    pairing.on_trigger(exposure_us(0))
    pairing.on_frame(frame(0, 20_000))
    pairing.on_frame(frame(0, 21_000))
    assert len(pairing.pairs(EVENT_ZERO_NS + exposure_us(1) * 1000)) == 1
    assert pairing.rejects.as_dict() == {"repeated": 1}


def test_CAMERA_REOPENED_starts_a_new_count_and_clock() -> None:
    pairing = FramePairing(params())
    first = [(k, frame(k, 20_000)) for k in range(5)]
    assert len(play(pairing, first, [(k, 0) for k in range(5)], exposure_us(5))) == 5
    pairing.forget_camera()
    again = [
        (
            k,
            Frame(
                IMAGE, EVENT_ZERO_NS + (exposure_us(k) + 20_000) * 1000, k - 9, (exposure_us(k) - exposure_us(9)) * 1000
            ),
        )
        for k in range(10, 15)
    ]
    pairs = play(pairing, again, [(k, 0) for k in range(10, 15)], exposure_us(20))
    assert [(k, pair.t_us) for k, pair in pairs] == [(k, exposure_us(k)) for k in range(10, 15)]
    assert pairing.frames_lost == 0


def test_EVENT_CLOCK_ANEW_forgets_triggers_that_wait() -> None:
    pairing = FramePairing(params())
    pairing.on_clock(event_us)
    pairing.on_trigger(exposure_us(0))
    pairing.forget_events()
    pairing.on_frame(frame(0, 20_000))
    assert pairing.pairs(EVENT_ZERO_NS + exposure_us(9) * 1000) == [], "no clock yet"
    pairing.on_clock(event_us)
    assert pairing.pairs(EVENT_ZERO_NS + exposure_us(9) * 1000) == []
    assert pairing.rejects.as_dict() == {"trigger_without_frame": 1, "frame_without_trigger": 1}


@pytest.mark.parametrize("shift", [-1, 1])
def test_a_clock_learned_from_a_false_latency_is_given_up(shift: int) -> None:
    """The first frame broke the promise on the latency, and was taken for another's; later ones put it right."""
    pairing = FramePairing(params())
    pairing.on_clock(event_us)
    wrong = frame(5, 20_000 - shift * PERIOD_US)
    pairing.on_trigger(exposure_us(5 - shift))
    pairing.on_frame(Frame(IMAGE, wrong.arrived_ns, UNKNOWN, wrong.device_ns))
    assert len(pairing.pairs(wrong.arrived_ns)) == 1
    frames = [(k, frame(k, 20_000, counter=False)) for k in range(8, 30)]
    pairs = play(pairing, frames, [(k, 0) for k in range(7, 30)], exposure_us(40))
    assert pairing.contradictions >= 1
    assert [(k, pair.t_us) for k, pair in pairs[-10:]] == [(k, exposure_us(k)) for k in range(20, 30)]
