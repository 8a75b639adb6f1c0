"""Gaps, repeats and restarts, from the sequence numbers and send times in the headers."""

from __future__ import annotations

from dataclasses import dataclass, field

REORDERED_AT_MOST = 8
"""So many old messages in a row are no repeats but a sender whose host's clock started anew."""


@dataclass
class _Sender:
    seq: int
    t_sent_ns: int
    lost: int = 0
    repeated: int = 0
    restarts: int = 0
    received: int = 0
    old_in_a_row: int = 0


@dataclass
class SequenceLedger:
    """Counts per sender."""

    _senders: dict[str, _Sender] = field(default_factory=dict)

    def note(self, sender: str, seq: int, t_sent_ns: int) -> int:
        """How many messages are missing just before this one; -1 if it is a repeat and must not be used.

        A lower number that was sent later is a sender that restarted: its numbers begin anew, nothing is missing that
        could be counted.
        """
        known = self._senders.get(sender)
        if known is None:
            self._senders[sender] = _Sender(seq, t_sent_ns, received=1)
            return 0
        lost = 0
        if seq > known.seq and t_sent_ns >= known.t_sent_ns:
            lost = seq - known.seq - 1
            known.lost += lost
        elif t_sent_ns > known.t_sent_ns or known.old_in_a_row >= REORDERED_AT_MOST:
            known.restarts += 1
        else:
            known.repeated += 1
            known.old_in_a_row += 1
            return -1
        known.seq, known.t_sent_ns, known.old_in_a_row = seq, t_sent_ns, 0
        known.received += 1
        return lost

    @property
    def received(self) -> int:
        """Messages used, of all senders."""
        return sum(sender.received for sender in self._senders.values())

    @property
    def lost(self) -> int:
        """Messages missing, of all senders."""
        return sum(sender.lost for sender in self._senders.values())

    @property
    def repeated(self) -> int:
        """Repeats refused."""
        return sum(sender.repeated for sender in self._senders.values())

    @property
    def restarts(self) -> int:
        """Restarts of senders seen."""
        return sum(sender.restarts for sender in self._senders.values())
