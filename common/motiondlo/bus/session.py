"""The bus: one session of one program, behind the topic table."""

from __future__ import annotations

import time
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from typing import Any, TypeVar

import zenoh

from motiondlo.bus.commands import CommandServer, ask
from motiondlo.bus.config import BusConfig
from motiondlo.bus.errors import BusError
from motiondlo.bus.inbox import wait_any
from motiondlo.bus.liveliness import AliveWatch
from motiondlo.bus.publisher import Publisher
from motiondlo.bus.settings import zenoh_config
from motiondlo.bus.shm import MIB, SharedMemory, SharedMemoryReport, memlock_problem
from motiondlo.bus.subscriber import InputStatus, Subscriber
from motiondlo.bus.tap import Tap
from motiondlo.messages.command import CommandAnswer, CommandRequest, Verb
from motiondlo.messages.header import Message, is_name
from motiondlo.messages.reject import Expectation
from motiondlo.topics import ALIVE, Delivery, Topic, all_keys

M = TypeVar("M", bound=Message)

_OPEN_RETRY_S = 0.2
READABLE_POOLS_MIB = 512
"""A reader locks the pools of all senders it hears in memory."""

Input = Subscriber[Any] | CommandServer | AliveWatch | Tap


class Bus:
    """Publishers, subscribers, commands and liveliness of one program. Use :func:`open_bus`.

    Everything received is taken by one thread, when it asks; nothing calls back.
    """

    def __init__(self, session: Any, config: BusConfig, source: str, no_shared_memory: str) -> None:
        self.config, self.source = config, source
        self._session = session
        self._no_shared_memory = no_shared_memory
        self._shared_memory: SharedMemory | None = None
        self._inputs: list[Input] = []
        self._publishers: list[Publisher[Any]] = []
        self._token: Any = None

    def publisher(self, topic: Topic[M], name: str = "") -> Publisher[M]:
        """A publisher on ``topic``; ``name`` fills the key of health (this program's own name by default).

        Raises BusError for a topic that is not published on (liveliness, commands).
        """
        if topic.delivery not in (Delivery.NEWEST, Delivery.RELIABLE):
            raise BusError(f"Nothing is published on {topic.name}.")
        name = name or (self.source if "{name}" in topic.suffix else "")
        if topic.shared_memory and self._shared_memory is None:
            self._shared_memory = SharedMemory(
                self.config.shared_memory_mib * MIB, not self._no_shared_memory, self._no_shared_memory
            )
        publisher = Publisher(
            self._session,
            topic,
            self.config.cell,
            self.source,
            name,
            self._shared_memory if topic.shared_memory else None,
        )
        self._publishers.append(publisher)
        return publisher

    def subscriber(self, topic: Topic[M], name: str = "", queue: int = 0) -> Subscriber[M]:
        """A subscriber to ``topic``.

        ``name``: a daemon, for health; all of them by default. ``queue``: another length than the row's.
        """
        name = name or ("*" if "{name}" in topic.suffix else "")
        subscriber = Subscriber(self._session, topic, self.config.cell, name, queue, self.config.same_host)
        self._inputs.append(subscriber)
        return subscriber

    def tap(self, queue: int = 1024) -> Tap:
        """Everything in the cell, undecoded."""
        tap = Tap(self._session, all_keys(self.config.cell), queue)
        self._inputs.append(tap)
        return tap

    def wait(self, timeout_s: float, *inputs: Input) -> bool:
        """Wait until one of ``inputs`` (all of this bus's by default) has something; whether one has."""
        return wait_any([entry.inbox for entry in inputs or self._inputs], timeout_s)

    def announce_alive(self) -> None:
        """Declare this daemon's liveliness token."""
        if self._token is None:
            self._token = self._session.liveliness().declare_token(ALIVE.key(self.config.cell, self.source))

    def watch_alive(self) -> AliveWatch:
        """Watch which daemons are there."""
        watch = AliveWatch(self._session, self.config.cell)
        self._inputs.append(watch)
        return watch

    def serve(self, verbs: Iterable[Verb]) -> CommandServer:
        """Offer to answer commands."""
        server = CommandServer(self._session, verbs, self.config.cell, self.source)
        self._inputs.append(server)
        return server

    def ask(
        self, verb: Verb, args: Mapping[str, Any] | None = None, target: str = "", timeout_s: float = 2.0
    ) -> tuple[CommandAnswer, ...]:
        """Give a command to ``target`` (to all that serve the verb by default) and wait for the answers.

        Raises CommandError: nobody serves the verb, no answer in time, or an answer that says no.
        """
        request = CommandRequest(verb=verb, target=target, args=dict(args or {}))
        return ask(self._session, request, self.config.cell, self.source, timeout_s)

    def last_value(self, topic: Topic[M], name: str = "", timeout_s: float = 1.0) -> M | None:
        """The newest message of a topic that keeps its last value; None if nobody has sent any.

        Raises Rejected if it is not good.
        """
        if not topic.last_value or topic.message is None:
            raise BusError(f"Topic {topic.name} keeps no last value.")
        expect = Expectation(self.config.cell, None, None, topic.max_payload_bytes)
        replies = self._session.get(
            topic.key(self.config.cell, name), zenoh.handlers.RingChannel(16), timeout=timeout_s
        )
        for reply in replies:
            if reply.ok is not None:
                return topic.message.from_bytes(reply.ok.payload.to_bytes(), expect)
        return None

    def inputs(self) -> dict[str, InputStatus]:
        """Status per subscribed topic, for health."""
        return {entry.topic.name: entry.status() for entry in self._inputs if isinstance(entry, Subscriber)}

    def drops(self) -> dict[str, int]:
        """``topic.lost`` and ``topic.repeated`` where there are any, and messages too large to send."""
        counts: dict[str, int] = {}
        for name, status in self.inputs().items():
            counts[f"{name}.lost"] = status.lost
            counts[f"{name}.repeated"] = status.repeated
        for publisher in self._publishers:
            counts[f"{publisher.topic.name}.too_large"] = publisher.too_large
        return {name: count for name, count in counts.items() if count}

    def rejects(self) -> tuple[dict[str, int], dict[str, int]]:
        """Refused messages: per reason, and per ``sender:reason``."""
        by_reason: dict[str, int] = {}
        by_sender: dict[str, int] = {}
        for entry in self._inputs:
            if isinstance(entry, Subscriber | CommandServer):
                for counts, total in ((entry.rejects.as_dict(), by_reason), (entry.rejects.senders(), by_sender)):
                    for name, count in counts.items():
                        total[name] = total.get(name, 0) + count
        return by_reason, by_sender

    def visitors(self) -> tuple[str, ...]:
        """Common names in the certificates of those who are linked over TLS now; the same name may be there twice."""
        names = [link.auth_identifier for link in self._session.info.links()]
        return tuple(sorted(name for name in names if name))

    def shared_memory_report(self) -> SharedMemoryReport:
        """Which way this program's large messages take."""
        if self._shared_memory is None:
            why = self._no_shared_memory or "this program sends no large messages"
            return SharedMemoryReport(False, why, 0, 0, 0, 0)
        return self._shared_memory.report()

    def close(self) -> None:
        """End all threads and declarations."""
        if self._token is not None:
            self._token.undeclare()
            self._token = None
        for closable in (*self._inputs, *self._publishers):
            closable.close()
        self._inputs.clear()
        self._publishers.clear()
        if self._shared_memory is not None:
            self._shared_memory.close()


@contextmanager
def open_bus(config: BusConfig, source: str) -> Iterator[Bus]:
    """Join the cell as ``source`` (a daemon's or program's name); the session is closed whatever happens.

    A peer is there at once and finds the others as they come; a client waits for its endpoint.

    Raises BusError: an endpoint cannot be listened on, or (client) is not reached within ``open_timeout_s``.
    """
    if not is_name(source):
        raise BusError(f"{source!r} is no name of a program.", "Use letters, digits, '_', '-' and '.'.")
    # zenoh logs to standard output, between a program's own lines: only if the environment (RUST_LOG) asks for it.
    init_log: Any = zenoh.try_init_log_from_env
    init_log()
    why_not = "" if config.shared_memory else "switched off in the configuration"
    why_not = why_not or memlock_problem(READABLE_POOLS_MIB * MIB)
    with _open(config, not why_not) as session:
        bus = Bus(session, config, source, why_not)
        try:
            yield bus
        finally:
            bus.close()


def _open(config: BusConfig, shared_memory: bool) -> Any:
    deadline = time.monotonic() + config.open_timeout_s
    while True:
        try:
            return zenoh.open(zenoh_config(config, shared_memory))
        except zenoh.ZError as error:
            if config.mode != "client":
                raise BusError(
                    f"Cannot listen on {', '.join(config.listen) or 'any endpoint'}: {error}",
                    "Is another process of this cell using the endpoint?",
                ) from None
            if time.monotonic() >= deadline:
                raise BusError(
                    f"Nobody answers at {', '.join(config.connect)}: {error}", "Is the cell running?"
                ) from None
        time.sleep(_OPEN_RETRY_S)
