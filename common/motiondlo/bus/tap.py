"""Receiving anything, undecoded."""

from __future__ import annotations

from typing import Any

import zenoh

from motiondlo.bus.inbox import Inbox, Pump, wait_any


class Tap:
    """Everything below a key expression as it is on the wire, for recorders: (key, payload), undecoded."""

    def __init__(self, session: Any, key: str, queue: int) -> None:
        from_zenoh = session.declare_subscriber(key, zenoh.handlers.RingChannel(queue))
        self._inbox: Inbox[Any] = Inbox(queue)
        self._pump: Pump[Any] = Pump("tap", from_zenoh.handler.recv, from_zenoh.undeclare, self._inbox)

    @property
    def inbox(self) -> Inbox[Any]:
        """For waiting on several inputs."""
        return self._inbox

    def recv(self, timeout_s: float = 0.0) -> tuple[str, bytes] | None:
        """The next message, or None."""
        sample = self._inbox.take()
        if sample is None and timeout_s > 0.0 and wait_any((self._inbox,), timeout_s):
            sample = self._inbox.take()
        return None if sample is None else (str(sample.key_expr), sample.payload.to_bytes())

    def close(self) -> None:
        """Stop receiving."""
        if self._pump.close():
            self._inbox.close()
