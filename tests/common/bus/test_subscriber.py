"""Receiving: order, losses, refusals, freshness."""

from __future__ import annotations

import time
from collections.abc import Iterator

import pytest
from tests.common.bus.fakes import FakeSession
from tests.common.messages.examples import all_messages, state

from motiondlo.bus.errors import BusError
from motiondlo.bus.subscriber import Subscriber
from motiondlo.messages.state import StateMessage
from motiondlo.topics import ALIVE, COMMAND, HEALTH, STATE

WAIT_S = 5.0


@pytest.fixture
def session() -> FakeSession:
    return FakeSession()


@pytest.fixture
def states(session: FakeSession) -> Iterator[Subscriber[StateMessage]]:
    subscriber = Subscriber(session, STATE, "cell1")
    yield subscriber
    subscriber.close()


def test_messages_come_in_order_and_their_losses_with_them(
    session: FakeSession, states: Subscriber[StateMessage]
) -> None:
    seen = []
    for seq in (4, 5, 5, 9):
        session.feed(state(), seq)
    for _ in range(3):
        message = states.recv(WAIT_S)
        assert message is not None
        seen.append((message.seq, states.lost_before))
    assert seen == [(4, 0), (5, 0), (9, 3)]
    status = states.status()
    assert (status.received, status.lost, status.repeated) == (3, 3, 1)
    assert states.rejects.as_dict() == {"repeated": 1}


def test_nothing_to_receive_is_none(states: Subscriber[StateMessage]) -> None:
    assert states.recv() is None
    assert states.recv(0.01) is None
    assert states.newest() is None


def test_the_newest_passes_over_older_ones(session: FakeSession, states: Subscriber[StateMessage]) -> None:
    for seq in range(20):
        session.feed(state(), seq)
    deadline = time.monotonic() + WAIT_S
    while len(states.inbox) < 20 and time.monotonic() < deadline:
        time.sleep(0.001)
    newest = states.newest()
    assert newest is not None
    assert newest.seq == 19
    assert states.status().lost == 0


def test_a_slow_reader_finds_the_newest_and_the_count_of_what_it_missed(session: FakeSession) -> None:
    subscriber = Subscriber(session, STATE, "cell1", queue=4)
    for seq in range(100):
        session.feed(state(), seq)
    deadline = time.monotonic() + WAIT_S
    while session.subscription.samples.qsize() and time.monotonic() < deadline:
        time.sleep(0.001)
    first = subscriber.recv(WAIT_S)
    assert first is not None
    for _ in range(3):
        assert subscriber.recv(WAIT_S) is not None
    session.feed(state(), 100)
    last = subscriber.recv(WAIT_S)
    assert last is not None
    assert (first.seq, last.seq) == (96, 100)
    subscriber.close()


def test_data_from_beyond_the_event_horizon_are_refused(session: FakeSession, states: Subscriber[StateMessage]) -> None:
    states.horizon_us = state().t_us - 2_000_000
    session.feed(state(), 0)
    states_seen = states.recv(0.2)
    assert states_seen is None
    assert states.rejects.as_dict() == {"future_time": 1}
    assert states.rejects.senders() == {"state:future_time": 1}
    states.horizon_us = state().t_us
    session.feed(state(), 1)
    assert states.recv(WAIT_S) is not None


def test_what_comes_after_an_outage_is_not_from_the_future(
    session: FakeSession, states: Subscriber[StateMessage], monkeypatch: pytest.MonkeyPatch
) -> None:
    now_ns = time.monotonic_ns()
    monkeypatch.setattr(time, "monotonic_ns", lambda: now_ns - 3_000_000_000)
    states.horizon_us = state().t_us - 3_000_000
    monkeypatch.undo()
    session.feed(state(), 0)
    assert states.recv(WAIT_S) is not None


def test_an_input_is_alive_until_its_deadline_has_passed(
    session: FakeSession, states: Subscriber[StateMessage]
) -> None:
    assert not states.status().alive
    session.feed(state(), 0)
    assert states.recv(WAIT_S) is not None
    now_ns = time.monotonic_ns()
    assert states.status(now_ns).alive
    assert not states.status(now_ns + int(STATE.deadline_ms * 1e6) + 1).alive


def test_a_sender_on_another_host_has_another_clock(session: FakeSession) -> None:
    elsewhere = Subscriber(session, STATE, "cell1", same_host=False)
    session.feed(state(), 0, t_sent_ns=time.monotonic_ns() + 10**15)
    assert elsewhere.recv(WAIT_S) is not None
    elsewhere.close()


def test_daemons_are_told_apart_by_their_names(session: FakeSession) -> None:
    health = Subscriber(session, HEALTH, "cell1", "*")
    for seq, source in enumerate(("fusion", "segmenter", "fusion")):
        session.feed(all_messages()["health"], seq, source=source)
    assert [message.source for message in (health.recv(WAIT_S) for _ in range(3)) if message] == [
        *("fusion", "segmenter", "fusion")
    ]
    assert health.ledger.lost == 1, "of fusion"
    health.close()


@pytest.mark.parametrize("row", [ALIVE, COMMAND])
def test_tokens_and_commands_are_not_subscribed_to(session: FakeSession, row: object) -> None:
    with pytest.raises(BusError):
        Subscriber(session, row, "cell1", "x")  # type: ignore[arg-type]


@pytest.mark.parametrize(("rate_hz", "ok"), [(1000.0, True), (200.0, True), (150.0, True), (50.0, False)])
def test_a_rate_far_below_the_nominal_one_is_not_ok(
    session: FakeSession, states: Subscriber[StateMessage], rate_hz: float, ok: bool
) -> None:
    start_ns = time.monotonic_ns()
    assert not states.status(start_ns).freq_ok
    n = int(1.1 * rate_hz)
    for i in range(n):
        states.tick(start_ns + round(i * 1e9 / rate_hz))
    status = states.status(start_ns + round(n * 1e9 / rate_hz))
    assert status.rate_hz == pytest.approx(rate_hz, rel=0.01)
    assert status.freq_ok == ok
    assert states.status(start_ns + 4 * 10**9).rate_hz == 0.0
