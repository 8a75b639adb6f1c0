"""Receiving on one topic: decoded, checked, counted."""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, Generic, TypeVar

from motiondlo.bus.errors import BusError
from motiondlo.bus.inbox import Inbox, Pump, wait_any
from motiondlo.bus.qos import declare_subscriber
from motiondlo.bus.sequence import SequenceLedger
from motiondlo.messages.header import Message
from motiondlo.messages.reject import Expectation, Rejected
from motiondlo.rejects import RejectCounter, RejectReason
from motiondlo.topics import Delivery, Topic

M = TypeVar("M", bound=Message)

RATE_WINDOW_NS = 1_000_000_000
RATE_WINDOW_PERIODS = 3
"""Slow topics are measured over so many nominal periods."""
FREQ_OK_SHARE = 0.5
"""A rate below this share of the nominal one is not ok."""


@dataclass(frozen=True)
class InputStatus:
    """One input, as its reader sees it."""

    alive: bool
    """The last message came within the topic's deadline."""
    freq_ok: bool
    """The rate is not far below the nominal one; false until it was measured; true for topics without a deadline."""
    rate_hz: float
    received: int
    lost: int
    repeated: int
    rejected: int
    restarts: int
    queued: int


class Subscriber(Generic[M]):
    """The messages of one topic, for one receiving thread."""

    def __init__(
        self, session: Any, topic: Topic[M], cell: str, name: str = "", queue: int = 0, same_host: bool = True
    ) -> None:
        """``queue``: another length than the row's. Raises BusError for a topic without messages."""
        if topic.message is None or topic.delivery is Delivery.QUERY:
            raise BusError(f"There is nothing to subscribe to on {topic.name}.")
        topic.message.prepare()
        queue = queue or topic.queue
        self.topic = topic
        self.key = topic.key(cell, name)
        self._horizon_us: int | None = None
        self._horizon_ns = 0
        self.lost_before = 0
        """Messages of the same sender that are missing just before the one received last."""
        self.rejects = RejectCounter()
        self.ledger = SequenceLedger()
        self._model, self._cell, self._same_host = topic.message, cell, same_host
        self._rejected = 0
        self._last_ns = -1
        self._window_start_ns, self._window_count, self._rate_hz = -1, 0, 0.0
        period_ns = 1e9 / topic.rate_hz if topic.rate_hz else 0.0
        self._window_ns = max(RATE_WINDOW_NS, int(RATE_WINDOW_PERIODS * period_ns))
        self._inbox: Inbox[Any] = Inbox(queue)
        subscription = declare_subscriber(session, topic, self.key, queue)
        self._pump: Pump[Any] = Pump(topic.name, subscription.handler.recv, subscription.undeclare, self._inbox)

    @property
    def horizon_us(self) -> int | None:
        """Newest event time that the reader knows of: data from far beyond it are refused. None: no check.

        It moves on with the host's clock, so that what comes after an outage of the sender is not taken for the future.
        """
        if self._horizon_us is None:
            return None
        return self._horizon_us + (time.monotonic_ns() - self._horizon_ns) // 1000

    @horizon_us.setter
    def horizon_us(self, t_us: int | None) -> None:
        self._horizon_us, self._horizon_ns = t_us, time.monotonic_ns()

    @property
    def inbox(self) -> Inbox[Any]:
        """For waiting on several inputs."""
        return self._inbox

    def recv(self, timeout_s: float = 0.0) -> M | None:
        """The next good message in order of arrival, waiting up to ``timeout_s``; None if there is none.

        Refused messages and repeats are counted and skipped.
        """
        deadline_ns = time.monotonic_ns() + int(timeout_s * 1e9)
        while True:
            sample = self._inbox.take()
            if sample is not None:
                message = self._accept(sample)
                if message is not None:
                    return message
                continue
            left_s = (deadline_ns - time.monotonic_ns()) * 1e-9
            if left_s <= 0.0 or not wait_any((self._inbox,), left_s):
                return None

    def drain(self) -> Iterator[M]:
        """All good messages that have arrived."""
        while (message := self.recv()) is not None:
            yield message

    def newest(self) -> M | None:
        """The newest good message that has arrived; the older ones are passed over."""
        newest = None
        while (message := self.recv()) is not None:
            newest = message
        return newest

    def _accept(self, sample: Any) -> M | None:
        now_ns = time.monotonic_ns()
        expect = Expectation(
            self._cell, now_ns if self._same_host else None, self.horizon_us, self.topic.max_payload_bytes
        )
        try:
            payload = sample.payload
            # Before the copy, so that a giant is refused for the price of a look.
            expect.check_size(len(payload))
            message = self._model.from_bytes(payload.to_bytes(), expect)
        except Rejected as rejected:
            self._rejected += 1
            self.rejects.count(rejected.reason, rejected.sender or self.topic.name)
            return None
        lost = self.ledger.note(message.source, message.seq, message.t_sent_ns)
        if lost < 0:
            self.rejects.count(RejectReason.REPEATED, message.source)
            return None
        self.lost_before = lost
        self.tick(now_ns)
        return message

    def tick(self, now_ns: int) -> None:
        """Note that a good message came at the host's monotonic time ``now_ns``."""
        self._last_ns = now_ns
        self._window_count += 1
        if self._window_start_ns < 0:
            self._window_start_ns = now_ns
        elif now_ns - self._window_start_ns >= self._window_ns:
            self._rate_hz = (self._window_count - 1) * 1e9 / (now_ns - self._window_start_ns)
            self._window_start_ns, self._window_count = now_ns, 1

    def status(self, now_ns: int | None = None) -> InputStatus:
        """How this input does, at the host's monotonic time ``now_ns``."""
        now_ns = time.monotonic_ns() if now_ns is None else now_ns
        silent_ns = now_ns - self._last_ns
        alive = self._last_ns >= 0 and (self.topic.deadline_ms == 0 or silent_ns <= self.topic.deadline_ms * 1e6)
        silent = self._last_ns < 0 or silent_ns > 2 * self._window_ns
        rate_hz = 0.0 if silent else self._rate_hz
        return InputStatus(
            alive=alive,
            freq_ok=self.topic.deadline_ms == 0 or rate_hz >= FREQ_OK_SHARE * self.topic.rate_hz,
            rate_hz=rate_hz,
            received=self.ledger.received,
            lost=self.ledger.lost,
            repeated=self.ledger.repeated,
            rejected=self._rejected,
            restarts=self.ledger.restarts,
            queued=len(self._inbox),
        )

    def close(self) -> None:
        """Stop receiving."""
        if self._pump.close():
            self._inbox.close()
