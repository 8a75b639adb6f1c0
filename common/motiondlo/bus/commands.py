"""Commands: a query on ``command/<verb>`` that daemons answer between two of their steps."""

from __future__ import annotations

import time
from collections.abc import Iterable, Mapping
from typing import Any

import zenoh

from motiondlo.bus.errors import CommandError
from motiondlo.bus.inbox import Inbox, Pump
from motiondlo.messages.command import CommandAnswer, CommandRequest, Verb
from motiondlo.messages.header import Stamp
from motiondlo.messages.reject import Expectation, Rejected
from motiondlo.rejects import RejectCounter
from motiondlo.topics import COMMAND

FIND_S = 1.0
"""A daemon's offer to serve reaches a session that has just been opened within this time."""
_RETRY_S = 0.05


class PendingCommand:
    """A command that waits for its answer."""

    def __init__(self, query: Any, request: CommandRequest, key: str, cell: str, daemon: str) -> None:
        self.request = request
        self._query, self._key, self._cell, self._daemon = query, key, cell, daemon

    def answer(self, result: Mapping[str, Any] | None = None) -> None:
        """Done, with values for the asker (numbers, texts, tuples of them)."""
        self._reply(
            CommandAnswer(verb=self.request.verb, daemon=self._daemon, ok=True, result=dict(result or {})),
        )

    def refuse(self, error: str, what_to_do: str = "") -> None:
        """Not done, and why."""
        self._reply(
            CommandAnswer(
                verb=self.request.verb, daemon=self._daemon, ok=False, error=error[:1000], what_to_do=what_to_do[:1000]
            )
        )

    def _reply(self, answer: CommandAnswer) -> None:
        with self._query as query:
            query.reply(self._key, answer.to_bytes(Stamp(0, self._cell, self._daemon, time.monotonic_ns())))


class CommandServer:
    """The commands that one daemon serves, waiting to be taken."""

    def __init__(self, session: Any, verbs: Iterable[Verb], cell: str, daemon: str) -> None:
        self.rejects = RejectCounter()
        self._cell, self._daemon = cell, daemon
        self._inbox: Inbox[Any] = Inbox(COMMAND.queue)
        self._pumps = []
        for verb in verbs:
            queryable = session.declare_queryable(
                COMMAND.key(cell, verb), zenoh.handlers.RingChannel(COMMAND.queue), complete=False
            )
            self._pumps.append(Pump(f"command {verb}", queryable.handler.recv, queryable.undeclare, self._inbox))

    @property
    def inbox(self) -> Inbox[Any]:
        """For waiting on several inputs."""
        return self._inbox

    def take(self) -> PendingCommand | None:
        """The next command for this daemon; each must be answered or refused. Wrong ones are refused here."""
        while (query := self._inbox.take()) is not None:
            key = str(query.key_expr)
            payload = b"" if query.payload is None else query.payload.to_bytes()
            try:
                request = CommandRequest.from_bytes(
                    payload, Expectation(self._cell, max_payload_bytes=COMMAND.max_payload_bytes)
                )
            except Rejected as rejected:
                self.rejects.count(rejected.reason, rejected.sender)
                with query:
                    query.reply_err(f"{self._daemon} cannot read the command: {rejected.detail}")
                continue
            if request.target in ("", self._daemon):
                return PendingCommand(query, request, key, self._cell, self._daemon)
            query.drop()
        return None

    def close(self) -> None:
        """Stop serving."""
        if all([pump.close() for pump in self._pumps]):
            self._inbox.close()


def ask(session: Any, request: CommandRequest, cell: str, source: str, timeout_s: float) -> tuple[CommandAnswer, ...]:
    """Ask and wait for all answers.

    Raises CommandError: nobody serves the verb, no answer within ``timeout_s``, or an answer that says no.
    """
    key = COMMAND.key(cell, request.verb)
    whom = request.target or "any daemon"
    start = time.monotonic()
    while True:
        payload = request.to_bytes(Stamp(0, cell, source, time.monotonic_ns()))
        left_s = timeout_s - (time.monotonic() - start)
        answers, errors = _get(session, key, payload, cell, max(left_s, _RETRY_S))
        elapsed_s = time.monotonic() - start
        if answers or errors or elapsed_s >= min(FIND_S, timeout_s):
            break
        # Nothing at once: nobody has offered to serve it, or the offer has not reached this session yet.
        time.sleep(_RETRY_S)
    refused = [answer for answer in answers if not answer.ok]
    if refused:
        first = refused[0]
        raise CommandError(f"{first.daemon} refuses {request.verb}: {first.error}", first.what_to_do)
    if errors:
        raise CommandError(f"{request.verb} failed: {errors[0]}")
    if answers:
        return tuple(answers)
    if elapsed_s >= timeout_s:
        raise CommandError(
            f"No answer to {request.verb} from {whom} within {timeout_s:g} s.", "See its health; it may be stopped."
        )
    raise CommandError(f"Nobody serves {request.verb} in cell {cell} ({whom}).", "Is the daemon running?")


def _get(session: Any, key: str, payload: bytes, cell: str, timeout_s: float) -> tuple[list[CommandAnswer], list[str]]:
    answers: list[CommandAnswer] = []
    errors: list[str] = []
    expect = Expectation(cell, max_payload_bytes=COMMAND.max_payload_bytes)
    replies = session.get(
        key,
        zenoh.handlers.RingChannel(256),
        payload=payload,
        timeout=timeout_s,
        target=zenoh.QueryTarget.ALL,
        consolidation=zenoh.ConsolidationMode.NONE,
    )
    for reply in replies:
        if reply.ok is None:
            text = reply.err.payload.to_bytes().decode("utf-8", "replace")
            if text.lower() != "timeout":
                errors.append(text)
            continue
        try:
            answers.append(CommandAnswer.from_bytes(reply.ok.payload.to_bytes(), expect))
        except Rejected as rejected:
            errors.append(str(rejected))
    return answers, errors
