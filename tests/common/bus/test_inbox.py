"""Inboxes keep the newest, and one thread can wait for several."""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator

import pytest

from motiondlo.bus.inbox import Inbox, wait_any


@pytest.fixture
def inboxes() -> Iterator[tuple[Inbox[int], Inbox[int]]]:
    pair = (Inbox[int](3), Inbox[int](3))
    yield pair
    for inbox in pair:
        inbox.close()


def test_a_full_inbox_keeps_the_newest_in_order(inboxes: tuple[Inbox[int], Inbox[int]]) -> None:
    inbox = inboxes[0]
    for item in range(10):
        inbox.put(item)
    assert len(inbox) == 3
    assert [inbox.take() for _ in range(4)] == [7, 8, 9, None]


def test_waiting_ends_at_once_when_something_is_there(inboxes: tuple[Inbox[int], Inbox[int]]) -> None:
    inboxes[1].put(1)
    start = time.monotonic()
    assert wait_any(inboxes, 5.0)
    assert time.monotonic() - start < 1.0


def test_waiting_ends_with_the_time_when_nothing_comes(inboxes: tuple[Inbox[int], Inbox[int]]) -> None:
    start = time.monotonic()
    assert not wait_any(inboxes, 0.03)
    assert 0.03 <= time.monotonic() - start < 1.0
    assert not wait_any(inboxes, 0.0)


def test_an_arrival_in_any_inbox_wakes_the_waiting_thread(inboxes: tuple[Inbox[int], Inbox[int]]) -> None:
    timer = threading.Timer(0.02, inboxes[1].put, (5,))
    timer.start()
    assert wait_any(inboxes, 5.0)
    assert inboxes[1].take() == 5
    timer.join()


def test_an_item_taken_without_waiting_does_not_fake_another(inboxes: tuple[Inbox[int], Inbox[int]]) -> None:
    inboxes[0].put(1)
    assert inboxes[0].take() == 1
    assert not wait_any(inboxes, 0.02)
