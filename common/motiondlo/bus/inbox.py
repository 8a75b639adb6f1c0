"""Where received items wait: a bounded queue that keeps the newest and that can be polled together with others."""

from __future__ import annotations

import os
import select
import threading
import time
from collections import deque
from collections.abc import Callable, Iterable
from typing import Generic, TypeVar

import zenoh

T = TypeVar("T")

JOIN_S = 2.0


class Inbox(Generic[T]):
    """A queue with one reader: when it is full, the oldest item makes room; an eventfd wakes the reader."""

    def __init__(self, capacity: int) -> None:
        self._items: deque[T] = deque(maxlen=capacity)
        self._fd = os.eventfd(0, os.EFD_NONBLOCK | os.EFD_CLOEXEC)

    def put(self, item: T) -> None:
        """Append (any thread)."""
        self._items.append(item)
        os.eventfd_write(self._fd, 1)

    def take(self) -> T | None:
        """The oldest item, or None; never waits."""
        try:
            return self._items.popleft()
        except IndexError:
            return None

    def __len__(self) -> int:
        return len(self._items)

    def fileno(self) -> int:
        """Readable when something may have arrived."""
        return self._fd

    def calm(self) -> None:
        """Make the file descriptor unreadable until the next arrival."""
        try:
            os.eventfd_read(self._fd)
        except BlockingIOError:
            return

    def close(self) -> None:
        """Give the file descriptor back; nothing may put any more."""
        os.close(self._fd)


def wait_any(inboxes: Iterable[Inbox[T]], timeout_s: float) -> bool:
    """Whether one of ``inboxes`` has something, waiting for it up to ``timeout_s``."""
    inboxes = list(inboxes)
    if any(inboxes):
        return True
    poll = select.poll()
    by_fd = {inbox.fileno(): inbox for inbox in inboxes}
    for fd in by_fd:
        poll.register(fd, select.POLLIN)
    deadline_ns = time.monotonic_ns() + int(timeout_s * 1e9)
    while True:
        left_ms = (deadline_ns - time.monotonic_ns()) / 1e6
        for fd, _ in poll.poll(max(0.0, left_ms)):
            by_fd[fd].calm()
        # An eventfd can be left over from an item that was taken without waiting: only the queues tell.
        if any(inboxes):
            return True
        if left_ms <= 0:
            return False


class Pump(Generic[T]):
    """A thread that moves what zenoh receives into an inbox.

    It blocks in zenoh's own channel, without the interpreter's lock, so a reader that computes for long never stalls
    zenoh's receiving threads (which also answer for this process being alive).

    Considered and rejected: direct callbacks (they need the interpreter's lock on zenoh's receiving thread: with one in
    each of three hops 400-490 us p50 against 340-390 us, and a long computation lets the lease run out); polling the
    channels (800 us at a period of 200 us).
    """

    def __init__(self, name: str, receive: Callable[[], T], stop: Callable[[], None], inbox: Inbox[T]) -> None:
        self._receive, self._stop, self._inbox = receive, stop, inbox
        self._thread = threading.Thread(target=self._run, name=f"bus {name}", daemon=True)
        self._thread.start()

    def _run(self) -> None:
        while True:
            try:
                item = self._receive()
            except zenoh.ZError:
                return  # undeclared, or the session is closed
            self._inbox.put(item)

    def close(self) -> bool:
        """Undeclare and end the thread; whether it has ended."""
        self._stop()
        self._thread.join(JOIN_S)
        return not self._thread.is_alive()
