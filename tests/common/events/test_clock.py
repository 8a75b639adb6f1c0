"""Event clock to host clock, with delays, drift and steps."""

from __future__ import annotations

import numpy as np
import pytest

from motiondlo.events.clock import ClockEstimator, ClockParams
from motiondlo.events.evt3 import Evt3Decoder
from motiondlo.events.types import EVENT_DTYPE, SensorGeometry
from motiondlo.events.writer import Evt3Encoder

OFFSET_NS = 7_000_000_000
PERIOD_US = 1000


def feed(
    clock: ClockEstimator, t_us: np.ndarray, drift_ppm: float = 0.0, jitter_us: float = 0.0, offset_ns: int = OFFSET_NS
) -> int:
    """Pairs with a true offset and drift, delayed by exponential jitter; returns how many steps were reported."""
    rng = np.random.default_rng(5)
    delay_ns = rng.exponential(jitter_us * 1000, len(t_us)).astype(np.int64) if jitter_us else np.zeros(len(t_us), int)
    host_ns = offset_ns + t_us * 1000 + np.round(t_us * drift_ppm * 1e-3).astype(np.int64) + delay_ns
    return sum(clock.update(int(t), int(h)) for t, h in zip(t_us, host_ns, strict=True))


def test_not_ready_before_the_first_pair() -> None:
    clock = ClockEstimator()
    assert not clock.ready
    with pytest.raises(RuntimeError):
        clock.host_ns(0)
    with pytest.raises(RuntimeError):
        clock.event_us(0)


def test_exact_pairs_give_the_exact_mapping_and_its_inverse() -> None:
    clock = ClockEstimator()
    assert feed(clock, np.arange(0, 3_000_000, PERIOD_US)) == 0
    assert clock.host_ns(2_500_000) == OFFSET_NS + 2_500_000_000
    assert clock.event_us(OFFSET_NS + 1_234_567_000) == 1_234_567
    assert abs(clock.drift_ppm) < 1e-6
    assert clock.uncertainty_us == 0.0


@pytest.mark.parametrize("drift_ppm", [-80.0, 0.0, 35.0])
def test_drift_and_offset_are_found_under_one_sided_jitter(drift_ppm: float) -> None:
    clock = ClockEstimator()
    t_us = np.arange(0, 15_000_000, PERIOD_US)
    assert feed(clock, t_us, drift_ppm, jitter_us=300.0) == 0
    assert clock.drift_ppm == pytest.approx(drift_ppm, abs=3.0)
    t = 15_000_000
    true_ns = OFFSET_NS + t * 1000 + round(t * drift_ppm * 1e-3)
    assert abs(clock.host_ns(t) - true_ns) < 20_000
    assert clock.event_us(clock.host_ns(t)) == pytest.approx(t, abs=1)


def test_rare_quiet_moments_suffice() -> None:
    """Nine of ten data are late by 2 to 8 ms: the mapping follows the tenth."""
    clock = ClockEstimator()
    rng = np.random.default_rng(1)
    for i in range(5000):
        t_us = i * PERIOD_US
        delay_ns = 10_000 if i % 10 == 0 else int(rng.integers(2_000_000, 8_000_000))
        assert not clock.update(t_us, OFFSET_NS + t_us * 1000 + delay_ns)
    assert abs(clock.host_ns(5_000_000) - OFFSET_NS - 5_000_000_000 - 10_000) < 5_000


def test_CLOCK_STEP_ahead_is_seen_with_the_first_datum() -> None:
    clock = ClockEstimator()
    assert feed(clock, np.arange(0, 3_000_000, PERIOD_US), jitter_us=100.0) == 0
    stepped = np.arange(3_500_000, 6_000_000, PERIOD_US)
    assert feed(clock, stepped, jitter_us=100.0, offset_ns=OFFSET_NS - 500_000_000) == 1
    assert clock.steps == 1
    assert abs(clock.host_ns(6_000_000) - (OFFSET_NS - 500_000_000) - 6_000_000_000) < 20_000


def test_CLOCK_STEP_camera_restarts_at_zero() -> None:
    clock = ClockEstimator()
    feed(clock, np.arange(0, 2_000_000, PERIOD_US))
    assert feed(clock, np.arange(0, 2_000_000, PERIOD_US), offset_ns=OFFSET_NS + 9_000_000_000) == 1
    assert clock.host_ns(1_000_000) == OFFSET_NS + 10_000_000_000


def test_CLOCK_STEP_to_a_later_arrival_is_told_from_a_stall() -> None:
    params = ClockParams(late_buckets=5)
    clock = ClockEstimator(params)
    feed(clock, np.arange(0, 2_000_000, PERIOD_US))
    stall = np.arange(2_000_000, 2_400_000, PERIOD_US)
    assert feed(clock, stall, offset_ns=OFFSET_NS + 60_000_000) == 0
    assert feed(clock, np.arange(2_400_000, 3_000_000, PERIOD_US)) == 0
    assert clock.host_ns(3_000_000) == OFFSET_NS + 3_000_000_000
    assert feed(clock, np.arange(3_000_000, 4_000_000, PERIOD_US), offset_ns=OFFSET_NS + 60_000_000) == 1
    assert clock.host_ns(4_000_000) == OFFSET_NS + 60_000_000 + 4_000_000_000


def test_an_earlier_arrival_lowers_the_offset_at_once() -> None:
    clock = ClockEstimator()
    clock.update(0, OFFSET_NS + 3_000_000)
    clock.update(1000, OFFSET_NS + 1_000_000)
    assert clock.host_ns(1000) == OFFSET_NS + 1_000_000


def test_uncertainty_grows_with_jitter() -> None:
    spread = []
    for jitter_us in (20.0, 2000.0):
        clock = ClockEstimator(ClockParams(bucket_us=10_000))
        feed(clock, np.arange(0, 3_000_000, PERIOD_US), jitter_us=jitter_us)
        spread.append(clock.uncertainty_us)
    assert spread[1] > 5 * spread[0] > 0


def test_drift_beyond_any_crystal_is_limited() -> None:
    clock = ClockEstimator()
    feed(clock, np.arange(0, 5_000_000, PERIOD_US), drift_ppm=900.0)
    assert clock.drift_ppm == 500.0


def test_PAUSE_of_minutes_is_no_step_and_keeps_the_drift() -> None:
    clock = ClockEstimator()
    drift_ppm = 40.0
    assert feed(clock, np.arange(0, 12_000_000, PERIOD_US), drift_ppm, jitter_us=100.0) == 0
    after_us = 12_000_000 + 300_000_000
    # What the drift's own error of 3 ppm makes of five minutes is 0.9 ms: far from a step.
    assert feed(clock, np.arange(after_us, after_us + 3_000_000, PERIOD_US), drift_ppm, jitter_us=100.0) == 0
    true_ns = OFFSET_NS + after_us * 1000 + round(after_us * drift_ppm * 1e-3)
    assert abs(clock.host_ns(after_us) - true_ns) < 1_000_000


def test_CLOCK_STEP_of_the_host_during_a_pause_is_seen_when_data_come_again() -> None:
    clock = ClockEstimator()
    feed(clock, np.arange(0, 3_000_000, PERIOD_US), jitter_us=100.0)
    after_us = 63_000_000
    assert feed(clock, np.arange(after_us, after_us + 2_000_000, PERIOD_US), offset_ns=OFFSET_NS + 80_000_000) == 1
    assert clock.host_ns(after_us + 2_000_000) == OFFSET_NS + 80_000_000 + (after_us + 2_000_000) * 1000


def test_WRAPS_of_the_cameras_24_bits_pass_the_clock_unnoticed() -> None:
    """Bytes in, through decoder and estimator: wraps after 16.8 s are no steps."""
    encoder, decoder = Evt3Encoder(SensorGeometry()), Evt3Decoder(SensorGeometry())
    clock = ClockEstimator()
    for t_us in range(1000, 3 << 24, 50_000):
        events = np.zeros(1, EVENT_DTYPE)
        events["t"] = t_us
        decoder.push(encoder.encode(events))
        assert not clock.update(decoder.time_us, OFFSET_NS + t_us * 1000)
    assert decoder.marks["wraps"] == 2
    # The decoder's time is that of the newest time word, up to 4.1 ms before the newest event.
    assert abs(clock.host_ns(t_us) - OFFSET_NS - t_us * 1000) < 5_000_000
