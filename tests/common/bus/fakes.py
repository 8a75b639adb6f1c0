"""A zenoh session that goes nowhere: what is put is kept, what is fed is received."""

from __future__ import annotations

import queue
from dataclasses import dataclass, field
from typing import Any

import zenoh

from motiondlo.messages.header import Message, Stamp


class FakePayload(bytes):
    """As zenoh's ZBytes."""

    def to_bytes(self) -> bytes:
        return bytes(self)


@dataclass
class FakeSample:
    """As zenoh's Sample."""

    payload: FakePayload
    key_expr: str = ""


@dataclass
class FakeSubscription:
    """As zenoh's Subscriber with a channel."""

    samples: queue.Queue[FakeSample | None] = field(default_factory=queue.Queue)

    @property
    def handler(self) -> FakeSubscription:
        return self

    def recv(self) -> FakeSample:
        sample = self.samples.get()
        if sample is None:
            raise zenoh.ZError("undeclared")
        return sample

    def undeclare(self) -> None:
        self.samples.put(None)


@dataclass
class FakeQuery:
    """As zenoh's Query."""

    replies: list[tuple[str, bytes]] = field(default_factory=list)

    def __enter__(self) -> FakeQuery:
        return self

    def __exit__(self, *_: object) -> None:
        return None

    def reply(self, key: str, payload: bytes) -> None:
        self.replies.append((key, payload))


@dataclass
class FakePublisher:
    """As zenoh's Publisher."""

    qos: dict[str, Any]
    sent: list[bytes] = field(default_factory=list)

    def put(self, payload: bytes) -> None:
        self.sent.append(payload)

    def undeclare(self) -> None:
        return None


@dataclass
class FakeSession:
    """As zenoh's Session, for one subscriber, publisher and queryable."""

    subscription: FakeSubscription = field(default_factory=FakeSubscription)
    publisher: FakePublisher | None = None
    answer: Any = None

    def declare_subscriber(self, key: str, handler: object) -> FakeSubscription:
        return self.subscription

    def declare_publisher(self, key: str, **qos: Any) -> FakePublisher:
        self.publisher = FakePublisher(qos)
        return self.publisher

    def declare_queryable(self, key: str, callback: Any) -> FakePublisher:
        self.answer = callback.callback
        return FakePublisher({})

    def feed(self, message: Message, seq: int, t_sent_ns: int | None = None, source: str = "sender") -> None:
        """Let the subscriber receive ``message``."""
        stamp = Stamp(seq, "cell1", source, seq if t_sent_ns is None else t_sent_ns)
        self.subscription.samples.put(FakeSample(FakePayload(message.to_bytes(stamp))))
