"""``command/segment`` with ``cancel``: which requests nobody needs any more. No clock.

Frames themselves are asked for from frame-capture; the segmenter hears of a request with its frame.
"""

from __future__ import annotations

from collections import deque
from typing import Protocol

from motiondlo.bus.commands import PendingCommand

MOST_REMEMBERED = 16
"""Cancellations that come before their frame; the oldest are forgotten."""


class Commands(Protocol):
    """Where commands come from."""

    def take(self) -> PendingCommand | None:
        """The next one."""
        ...


class Withdrawals:
    """Answers the commands and remembers the ids of cancelled requests."""

    def __init__(self, commands: Commands) -> None:
        self._commands = commands
        self._ids: deque[str] = deque(maxlen=MOST_REMEMBERED)

    def look(self) -> None:
        """Take what has come; never waits."""
        while (command := self._commands.take()) is not None:
            request_id = command.request.args.get("cancel")
            if isinstance(request_id, str) and request_id:
                self._ids.append(request_id)
                command.answer()
            elif command.request.target:
                command.refuse("The segmenter takes frames, not requests for them.", "Ask frame-capture to segment.")
            else:
                command.answer({"accepted": False})

    def has(self, request_id: str) -> bool:
        """Whether the request was cancelled."""
        return bool(request_id) and request_id in self._ids
