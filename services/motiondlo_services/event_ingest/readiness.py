"""Whether the tracker has the first shapes, judged from what the other daemons say of themselves. No I/O."""

from __future__ import annotations

from motiondlo.messages.health import HealthMessage

MAX_FAILURES = 3
"""So many failed segmentations of a scene at rest: the next one will not be better."""


class TrackerReadiness:
    """Fed with health messages; decided once the tracker has all that fusion has sent, or nothing more will come."""

    def __init__(self) -> None:
        self._sent = 0
        self._taken = 0
        self._failures = 0
        self._seen: set[str] = set()

    def on_health(self, health: HealthMessage) -> None:
        """Take one message of any daemon."""
        self._seen.add(health.daemon)
        if health.daemon == "fusion":
            self._sent = _count(health, "corrections")
            self._failures = _count(health, "failed_segmentations")
        elif health.daemon == "event-tracker":
            self._taken = _count(health, "corrections") + sum(health.rejects.values())

    @property
    def ready(self) -> bool:
        """The tracker has what fusion sent."""
        return 0 < self._sent <= self._taken

    @property
    def decided(self) -> bool:
        """Nothing more to wait for, for better or worse."""
        return self.ready or self._failures >= MAX_FAILURES

    @property
    def missing(self) -> str:
        """What is waited for, for people."""
        for daemon in ("event-tracker", "fusion", "frame-capture", "segmenter"):
            if daemon not in self._seen:
                return f"{daemon} to start"
        if self._failures:
            return f"a segmentation that works ({self._failures} failed)"
        if not self._sent:
            return "the first segmentation"
        return "" if self.ready else "the tracker to take the first shapes"


def _count(health: HealthMessage, name: str) -> int:
    value = health.info.get(name, 0)
    return int(value) if isinstance(value, int | float) else 0
