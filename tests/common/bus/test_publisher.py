"""Sending: stamps, bounds, quality of service, last values."""

from __future__ import annotations

import dataclasses
import time

import pytest
import zenoh
from tests.common.bus.fakes import FakeQuery, FakeSession
from tests.common.messages.examples import all_messages, state

from motiondlo.bus.publisher import Publisher
from motiondlo.messages.reject import Expectation
from motiondlo.messages.state import StateMessage
from motiondlo.topics import FRAME, HEALTH, STATE, TRACK, Priority, Topic


def sent(session: FakeSession) -> list[bytes]:
    """What went out."""
    assert session.publisher is not None
    return session.publisher.sent


def test_messages_are_stamped_and_numbered_when_they_are_sent() -> None:
    session = FakeSession()
    publisher = Publisher(session, STATE, "cell1", "fusion", "", None)
    before_ns = time.monotonic_ns()
    assert [publisher.put(state()) for _ in range(3)] == [0, 1, 2]
    read = [StateMessage.from_bytes(payload, Expectation("cell1", time.monotonic_ns())) for payload in sent(session)]
    assert [message.seq for message in read] == [0, 1, 2]
    assert all(before_ns <= message.t_sent_ns <= time.monotonic_ns() for message in read)


def test_a_message_too_large_for_its_topic_is_counted_and_leaves_no_gap() -> None:
    session = FakeSession()
    small = dataclasses.replace(STATE, max_payload_bytes=100)
    publisher = Publisher(session, small, "cell1", "fusion", "", None)
    publisher.put(state())
    assert (publisher.sent, publisher.too_large, sent(session)) == (0, 1, [])


@pytest.mark.parametrize("row", [STATE, TRACK, FRAME])
def test_nobody_waits_for_readers(row: Topic[StateMessage]) -> None:
    session = FakeSession()
    Publisher(session, row, "cell1", "fusion", "", None)
    assert session.publisher is not None
    qos = session.publisher.qos
    assert qos["congestion_control"] == zenoh.CongestionControl.DROP
    assert qos["express"] == (row.priority is Priority.REAL_TIME)


def test_the_last_value_is_the_answer_to_a_query() -> None:
    session = FakeSession()
    publisher = Publisher(session, HEALTH, "cell1", "fusion", "fusion", None)
    query = FakeQuery()
    session.answer(query)
    assert query.replies == []
    publisher.put(all_messages()["health"])  # type: ignore[arg-type]
    session.answer(query)
    assert query.replies == [("motiondlo/cell1/health/fusion", sent(session)[-1])]
