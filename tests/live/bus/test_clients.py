"""Other people's programs: with our client, and with zenoh and msgpack alone."""

from __future__ import annotations

import itertools
import sys
import time
from collections.abc import Callable
from pathlib import Path

import pytest
from tests.live.bus.conftest import CELL, Process

from motiondlo.bus.config import BusConfig
from motiondlo.bus.errors import BusError
from motiondlo.bus.session import open_bus
from motiondlo.client import StateStale, StateSubscriber
from motiondlo.messages.reject import ANYTHING
from motiondlo.messages.state import StateMessage
from motiondlo.topics import CORRECTION, STATE

pytestmark = pytest.mark.live

EXAMPLE = Path(__file__).resolve().parents[3] / "examples" / "plain_subscriber.py"


def test_the_client_follows_the_state(worker: Callable[..., Process], endpoints: dict[str, str]) -> None:
    worker("publish", "one", name="state", hz=200)
    with StateSubscriber(endpoints["one"], CELL) as cell:
        states = list(itertools.islice(cell, 20))
        assert [state.mode for state in states] == ["MOTION"] * 20
        assert not cell.stale
        assert 0.0 < cell.latency_ms < 100.0
        asked = cell.last_value()
        assert asked is not None
        assert asked.seq >= states[-1].message.seq
        with pytest.raises(StateStale, match="ms before the time asked for"):
            states[-1].at(states[-1].t_us + 1_000_000)
        (dlo,) = cell.at(states[-1].t_us + 1_000_000, allow_stale=True)
        assert dlo.nodes.shape == (50, 2)
        assert dlo.ahead_us <= 1_000_000, "carried on from the newest state"
        (now,) = cell.next().now()
        assert now.ahead_us < 100_000


def test_the_client_reaches_through_one_peer_what_another_sends(
    worker: Callable[..., Process], endpoints: dict[str, str]
) -> None:
    worker("publish", "one", name="state", hz=200)
    worker("serve", "two")
    with StateSubscriber(endpoints["two"], CELL) as cell:
        assert cell.next(timeout_s=5.0).mode == "MOTION"


def test_a_gate_lets_clients_in_and_duplicates_nothing_inside(
    worker: Callable[..., Process], endpoints: dict[str, str]
) -> None:
    worker("publish", "one", name="state", hz=200)
    worker("idle", "three", bus={"mode": "router"})
    with (
        StateSubscriber(endpoints["three"], CELL) as cell,
        open_bus(BusConfig.mesh(CELL, endpoints, "two"), "two") as bus,
    ):
        inside = bus.subscriber(STATE)
        for _ in range(100):
            assert cell.next(timeout_s=5.0).mode == "MOTION"
        assert inside.newest() is not None
        for status in (cell.status(), inside.status()):
            assert (status.repeated, status.rejected, status.lost) == (0, 0, 0)


def test_a_tap_sees_everything_as_it_is_on_the_wire(worker: Callable[..., Process], endpoints: dict[str, str]) -> None:
    worker("publish", "one", name="state", hz=100)
    worker("publish", "two", name="correction", hz=100)
    with open_bus(BusConfig.mesh(CELL, endpoints, "three"), "three") as bus:
        tap = bus.tap()
        heard: dict[str, bytes] = {}
        for _ in range(500):
            if len(heard) == 2:
                break
            bus.wait(1.0, tap)
            heard.update([item for item in [tap.recv()] if item is not None])
        assert set(heard) == {STATE.key(CELL), CORRECTION.key(CELL)}
        assert StateMessage.from_bytes(heard[STATE.key(CELL)], ANYTHING).mode == "MOTION"


def test_a_silent_cell_is_stale_and_says_so(worker: Callable[..., Process], endpoints: dict[str, str]) -> None:
    worker("serve", "one")
    with StateSubscriber(endpoints["one"], CELL) as cell:
        with pytest.raises(StateStale, match="fusion"):
            cell.next(timeout_s=0.1)
        with pytest.raises(StateStale, match="yet"):
            cell.newest()
        assert cell.stale
        assert cell.last_value(timeout_s=0.2) is None
        with pytest.raises(StateStale):
            cell.at(0)


def test_a_state_that_has_become_old_is_refused_unless_asked_for(
    worker: Callable[..., Process], endpoints: dict[str, str]
) -> None:
    worker("publish", "one", name="state", hz=50)
    with StateSubscriber(endpoints["one"], CELL, stale_ms=0.0) as cell:
        state = cell.next(timeout_s=5.0)
        assert state.stale
        with pytest.raises(StateStale, match="allow_stale"):
            cell.newest()
        assert cell.newest(allow_stale=True).t_us >= state.t_us


def test_the_example_of_the_client_follows_the_cables(
    worker: Callable[..., Process], run: Callable[[list[str]], Process], endpoints: dict[str, str]
) -> None:
    worker("publish", "one", name="state", hz=50)
    example = run([sys.executable, str(EXAMPLE.with_name("follow_cables.py")), endpoints["one"], CELL])
    _, ahead_us, dlo_id, _, y, sigma_px = example.line().split()
    assert (dlo_id, y) == ("1", "300.0")
    assert 0 <= int(ahead_us) < 100_000
    assert float(sigma_px) >= 1.0


def test_an_absent_cell_is_an_error_that_says_so(endpoints: dict[str, str]) -> None:
    start = time.monotonic()
    with (
        pytest.raises(BusError, match="Is the cell running"),
        StateSubscriber(endpoints["one"], CELL, open_timeout_s=0.1),
    ):
        pass
    assert time.monotonic() - start < 5.0


def test_fifteen_lines_without_our_code_read_the_state(
    worker: Callable[..., Process], run: Callable[[list[str]], Process], endpoints: dict[str, str]
) -> None:
    assert "motiondlo." not in EXAMPLE.read_text()
    worker("publish", "one", name="state", hz=50)
    example = run([sys.executable, str(EXAMPLE), endpoints["one"], CELL])
    t_us, mode, dlo_id, confidence = example.line().split(maxsplit=4)[:4]
    assert (int(t_us) % 1000, mode, dlo_id, confidence) == (0, "MOTION", "1", "0.90")
