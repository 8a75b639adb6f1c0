"""Who is there: a token per daemon that vanishes with it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import zenoh

from motiondlo.bus.inbox import Inbox, Pump, wait_any
from motiondlo.topics import ALIVE


@dataclass(frozen=True)
class AliveChange:
    """A daemon came or went."""

    daemon: str
    alive: bool


class AliveWatch:
    """Which daemons of the cell are there; changes are noticed when :meth:`take` is called."""

    def __init__(self, session: Any, cell: str) -> None:
        tokens = session.liveliness().declare_subscriber(
            ALIVE.key(cell, "*"), zenoh.handlers.RingChannel(ALIVE.queue), history=True
        )
        self._alive: set[str] = set()
        self._inbox: Inbox[Any] = Inbox(ALIVE.queue)
        self._pump: Pump[Any] = Pump(ALIVE.name, tokens.handler.recv, tokens.undeclare, self._inbox)

    @property
    def inbox(self) -> Inbox[Any]:
        """For waiting on several inputs."""
        return self._inbox

    @property
    def alive(self) -> frozenset[str]:
        """The daemons that are there, as far as the changes taken say."""
        return frozenset(self._alive)

    def take(self, timeout_s: float = 0.0) -> AliveChange | None:
        """The next change, waiting up to ``timeout_s``; None if there is none."""
        sample = self._inbox.take()
        if sample is None and timeout_s > 0.0 and wait_any((self._inbox,), timeout_s):
            sample = self._inbox.take()
        if sample is None:
            return None
        daemon = str(sample.key_expr).rsplit("/", 1)[-1]
        alive = sample.kind == zenoh.SampleKind.PUT
        if alive:
            self._alive.add(daemon)
        else:
            self._alive.discard(daemon)
        return AliveChange(daemon, alive)

    def update(self) -> frozenset[str]:
        """Take all changes; gives the daemons that are there."""
        while self.take() is not None:
            continue
        return self.alive

    def close(self) -> None:
        """Stop watching."""
        if self._pump.close():
            self._inbox.close()
