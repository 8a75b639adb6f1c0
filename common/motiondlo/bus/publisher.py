"""Sending on one topic."""

from __future__ import annotations

import time
from typing import Any, Generic, TypeVar

import zenoh

from motiondlo.bus.errors import BusError
from motiondlo.bus.qos import declare_publisher
from motiondlo.bus.shm import SharedMemory
from motiondlo.messages.header import Message, Stamp
from motiondlo.topics import Topic

M = TypeVar("M", bound=Message)


class Publisher(Generic[M]):
    """Stamps and sends the messages of one topic; one thread at a time.

    For topics with a last value it also answers queries with the newest message.
    """

    def __init__(
        self, session: Any, topic: Topic[M], cell: str, source: str, name: str, shared_memory: SharedMemory | None
    ) -> None:
        self.topic = topic
        self.key = topic.key(cell, name)
        self.sent = 0
        self.too_large = 0
        self._cell, self._source = cell, source
        self._shared_memory = shared_memory
        self._publisher = declare_publisher(session, topic, self.key)
        self._last: bytes | None = None
        self._queryable = self._answer_queries(session) if topic.last_value else None

    def put(self, message: M) -> int:
        """Send ``message``; gives its sequence number.

        Never waits for readers. A message larger than the topic allows is counted and not sent.

        Raises BusError if the session is closed.
        """
        seq = self.sent
        head, tail = message.to_parts(Stamp(seq, self._cell, self._source, time.monotonic_ns()))
        n_bytes = len(head) + (len(tail) if tail is not None else 0)
        if n_bytes > self.topic.max_payload_bytes:
            self.too_large += 1
            return seq
        if self._shared_memory is not None:
            payload = self._shared_memory.payload(head, tail)
        else:
            payload = head if tail is None else b"".join((head, tail))
        if self._queryable is not None:
            self._last = payload
        try:
            self._publisher.put(payload)
        except zenoh.ZError as error:
            raise BusError(f"Cannot send on {self.key}: {error}") from None
        self.sent += 1
        return seq

    def has_readers(self) -> bool:
        """Whether anyone is subscribed now (always true for reliable topics, whose messages are kept for later)."""
        status = getattr(self._publisher, "matching_status", None)
        return True if status is None else bool(status.matching)

    def close(self) -> None:
        """Stop sending."""
        if self._queryable is not None:
            self._queryable.undeclare()
        self._publisher.undeclare()

    def _answer_queries(self, session: Any) -> Any:
        def answer(query: Any) -> None:
            with query:
                if self._last is not None:
                    query.reply(self.key, self._last)

        # Direct: a default (indirect) callback keeps the interpreter from ending. It only hands out bytes.
        return session.declare_queryable(self.key, zenoh.handlers.Callback(answer, indirect=False))
