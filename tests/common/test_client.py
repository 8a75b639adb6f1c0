"""Extrapolation from a state to now, and freshness."""

from __future__ import annotations

import time

import numpy as np
import pytest
from tests.common.messages.examples import points, state

from motiondlo.client import (
    ACCELERATION_SHARE_PER_S,
    ACCELERATION_SIGMA_PX_S2,
    CellState,
    StateStale,
    entered_at,
    extrapolate,
)
from motiondlo.messages.events import ClockMessage

CLOCK = ClockMessage(t_us=0, anchor_us=1_000_000, anchor_host_ns=5_000_000_000)


def received(entered_ns: int, stale_ms: float = 50.0, clock: ClockMessage | None = CLOCK) -> CellState:
    return CellState(state(), entered_ns + 1_000_000, entered_ns, stale_ms, clock)


def test_nodes_move_with_their_velocity_and_grow_uncertain() -> None:
    (dlo,) = extrapolate(state(), state().t_us + 100_000)
    np.testing.assert_allclose(dlo.nodes, points() + 2.0, atol=1e-4)
    acceleration = ACCELERATION_SIGMA_PX_S2 + ACCELERATION_SHARE_PER_S * np.hypot(20.0, 20.0)
    np.testing.assert_allclose(dlo.sigma_px, np.hypot(0.5, 0.5 * acceleration * 0.01), rtol=1e-6)
    assert dlo.ahead_us == 100_000


def test_a_time_before_the_state_gives_the_state() -> None:
    (dlo,) = extrapolate(state(), 0)
    np.testing.assert_allclose(dlo.nodes, points(), atol=1e-4)
    np.testing.assert_allclose(dlo.sigma_px, 0.5)


def test_a_host_time_is_taken_to_event_time_by_the_cells_clock() -> None:
    cell_state = received(entered_ns=5_003_000_000)
    assert cell_state.event_us(5_011_000_000) == 1_011_000
    (dlo,) = cell_state.at_host(5_011_000_000)
    assert dlo.ahead_us == 10_000


def test_without_a_clock_the_newest_event_says_what_time_it_is() -> None:
    assert received(entered_ns=5_003_000_000, clock=None).event_us(5_005_000_000) == state().t_us + 2000


def test_what_lies_too_far_ahead_is_refused_unless_asked_for() -> None:
    cell_state = received(entered_ns=0)
    with pytest.raises(StateStale, match="51 ms before the time asked for, 50 ms at most"):
        cell_state.at(state().t_us + 51_000)
    assert cell_state.at(state().t_us + 51_000, allow_stale=True)[0].ahead_us == 51_000


def test_freshness_is_told_by_this_hosts_clock() -> None:
    assert received(entered_ns=time.monotonic_ns() - 60_000_000).stale
    assert not received(entered_ns=time.monotonic_ns(), stale_ms=1e6).stale
    assert received(entered_ns=0).age_ms_at(7_000_000) == 7.0


@pytest.mark.parametrize("mode", ["BOOT", "STATIC", "MOTION", "DEGRADED"])
def test_degraded_is_what_the_cell_says(mode: str) -> None:
    message = state().model_copy(update={"mode": mode})
    assert CellState(message, 0, 0, 50.0).degraded == (mode in ("BOOT", "DEGRADED"))


@pytest.mark.parametrize("same_host", [True, False])
def test_CAMERA_GONE_a_state_that_is_sent_again_is_as_old_as_it_was(same_host: bool) -> None:
    first, other = state(), state().model_copy(update={"t_ingest_ns": state().t_ingest_ns + 1})
    entered_ns = entered_at(first, 9_000, same_host, None)
    assert entered_ns == (first.t_ingest_ns if same_host else 9_000)
    before = CellState(first, 9_000, entered_ns, 50.0)
    assert entered_at(first, 500_009_000, same_host, before) == entered_ns
    assert entered_at(other, 500_009_000, same_host, before) == (other.t_ingest_ns if same_host else 500_009_000)
