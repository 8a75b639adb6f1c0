"""What a reader expects of a message, and the refusal with its reason."""

from __future__ import annotations

from dataclasses import dataclass

from motiondlo.rejects import RejectReason

FUTURE_TOLERANCE_NS = 1_000_000
"""Host clocks of one machine agree; this allows for the granularity of stamps taken on different cores."""
FUTURE_TOLERANCE_US = 1_000_000
"""Event time a message may lie ahead of the newest event time that its reader knows of (readers run behind)."""


class Rejected(Exception):
    """A message that is not used: why, in words, and who sent it (empty when the header cannot be read)."""

    def __init__(self, reason: RejectReason, detail: str, sender: str = "") -> None:
        super().__init__(f"{reason.value} from {sender or 'unknown'}: {detail}")
        self.reason = reason
        self.detail = detail
        self.sender = sender


@dataclass(frozen=True, slots=True)
class Expectation:
    """What the reader knows and therefore demands; None switches a check off."""

    cell: str | None = None
    now_ns: int | None = None
    """Host monotonic time of receipt; None when the sender may be on another host (its clock is another one)."""
    horizon_us: int | None = None
    """Newest event time the reader knows of."""
    max_payload_bytes: int = 1 << 26

    def check_size(self, n_bytes: int) -> None:
        """Raises Rejected(TOO_LARGE); done before anything is parsed."""
        if n_bytes > self.max_payload_bytes:
            raise Rejected(RejectReason.TOO_LARGE, f"{n_bytes} bytes, at most {self.max_payload_bytes}")

    def check_times(self, t_us: int, t_sent_ns: int, t_ingest_ns: int, sender: str) -> None:
        """Raises Rejected(FUTURE_TIME) for data from the future of the host's clock or of the event clock."""
        if self.now_ns is not None and max(t_sent_ns, t_ingest_ns) > self.now_ns + FUTURE_TOLERANCE_NS:
            ahead_ns = max(t_sent_ns, t_ingest_ns) - self.now_ns
            raise Rejected(RejectReason.FUTURE_TIME, f"host stamp {ahead_ns} ns ahead of the reader", sender)
        if self.horizon_us is not None and t_us > self.horizon_us + FUTURE_TOLERANCE_US:
            raise Rejected(RejectReason.FUTURE_TIME, f"t_us {t_us} beyond newest event {self.horizon_us}", sender)


ANYTHING = Expectation()
"""For tools that read stored messages: only the message's own consistency is checked."""
