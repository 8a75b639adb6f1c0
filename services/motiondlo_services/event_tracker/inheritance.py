"""Corrections from before a tracker's start: fusion's cache hands them to every tracker that joins. No I/O, no clock.

At a cell's start they are the scene's first shapes, and wanted. After a restart in a running cell they tell where the
DLOs once were; then fusion sees an update without DLOs and sends the newest shapes by itself. So old ones wait for a
moment, and are refused when something newer comes.
"""

from __future__ import annotations

from motiondlo.messages.correction import CorrectionMessage

HOLD_NS = 300_000_000
"""Fusion answers an update without DLOs within a few milliseconds, once it is linked."""


class Inheritance:
    """Sorts corrections of one process's first moments."""

    def __init__(self, started_ns: int, hold_ns: int = HOLD_NS) -> None:
        """started_ns: host time at which this process subscribed."""
        self._started_ns = started_ns
        self._hold_ns = hold_ns
        self._held: list[CorrectionMessage] = []
        self._until_ns = 0
        self._settled = False

    def sort(self, message: CorrectionMessage, now_ns: int) -> tuple[list[CorrectionMessage], list[CorrectionMessage]]:
        """Which corrections to take now, and which are superseded."""
        if message.t_sent_ns >= self._started_ns:
            superseded, self._held, self._settled = self._held, [], True
            return [message], superseded
        if self._settled:
            return [], [message]
        if not self._held:
            self._until_ns = now_ns + self._hold_ns
        self._held.append(message)
        return [], []

    def due(self, now_ns: int) -> list[CorrectionMessage]:
        """Those that nothing newer has replaced in time."""
        if not self._held or now_ns < self._until_ns:
            return []
        due, self._held = self._held, []
        return due
