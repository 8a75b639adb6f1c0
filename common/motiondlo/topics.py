"""The topic table: one row a topic. Nobody writes a key expression, a rate or a queue length anywhere else."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from typing import Any, Final, Generic, TypeVar

from motiondlo.errors import MotionDLOError
from motiondlo.messages.command import VERBS, CommandRequest
from motiondlo.messages.correction import CorrectionMessage
from motiondlo.messages.events import ClockMessage, EventBatchMessage, TriggerMessage
from motiondlo.messages.frame import FrameMessage
from motiondlo.messages.header import Message, is_name
from motiondlo.messages.health import HealthMessage
from motiondlo.messages.segmentation import SegmentationMessage
from motiondlo.messages.state import StateMessage
from motiondlo.messages.track import TrackMessage

M = TypeVar("M", bound=Message)

ROOT: Final = "motiondlo"
KIB: Final = 1 << 10
MIB: Final = 1 << 20


class Priority(StrEnum):
    """zenoh's priorities, highest first."""

    REAL_TIME = "real_time"
    INTERACTIVE_HIGH = "interactive_high"
    INTERACTIVE_LOW = "interactive_low"
    DATA_HIGH = "data_high"
    DATA = "data"
    BACKGROUND = "background"


class Delivery(StrEnum):
    """What happens when a reader does not keep up, or is away for a while."""

    NEWEST = "newest"
    """The oldest messages are dropped; losses are counted by gaps in the sequence numbers."""
    RELIABLE = "reliable"
    """The publisher keeps the last ones; readers that join late or were stopped fetch what they missed, in order."""
    LIVELINESS = "liveliness"
    """No payload: a token that exists as long as its daemon does."""
    QUERY = "query"
    """A question with an answer or a clear error."""


@dataclass(frozen=True)
class Topic(Generic[M]):
    """One row; ``M`` is the type of its messages."""

    name: str
    suffix: str
    """Key expression below ``motiondlo/<cell>/``; ``{name}`` stands for a daemon or a verb."""
    message: type[M] | None
    rate_hz: float
    """Nominal, for what follows the event batches at their slowest (200 to 1000 Hz); 0: now and then."""
    deadline_ms: float
    """Longest silence of a healthy sender; a reader calls the topic stale after it. 0: none."""
    priority: Priority
    delivery: Delivery
    queue: int
    """Messages that a reader's queue holds; for RELIABLE also those that the publisher keeps for others to fetch."""
    shared_memory: bool
    """Goes through shared memory where a message is large enough for it to pay."""
    max_payload_bytes: int
    owner: str
    """The daemon that publishes (or serves)."""
    readers: tuple[str, ...]
    last_value: bool = False
    """The newest message is also the answer to a query on the same key."""

    def key(self, cell: str, name: str = "") -> str:
        """The key expression in ``cell``; ``name`` fills ``{name}`` ("*": all of them).

        Raises MotionDLOError for a cell or a name that would be another key.
        """
        if not is_name(cell):
            raise MotionDLOError(f"{cell!r} is no cell name.", "Use letters, digits, '_', '-' and '.'.")
        takes_name = "{name}" in self.suffix
        if takes_name != bool(name) or not (name in ("", "*") or is_name(name)):
            raise MotionDLOError(f"Topic {self.name} with the name {name!r} is no key.")
        return f"{ROOT}/{cell}/{self.suffix.format(name=name)}"


EVENTS_BATCH: Final[Topic[EventBatchMessage]] = Topic(
    name="events/batch",
    suffix="events/batch",
    message=EventBatchMessage,
    rate_hz=200,
    deadline_ms=50,
    priority=Priority.REAL_TIME,
    delivery=Delivery.NEWEST,
    queue=32,
    shared_memory=True,
    max_payload_bytes=17 * MIB,
    owner="event-ingest",
    readers=("event-tracker", "recorder"),
)

EVENTS_TRIGGER: Final[Topic[TriggerMessage]] = Topic(
    name="events/trigger",
    suffix="events/trigger",
    message=TriggerMessage,
    rate_hz=40,
    deadline_ms=0,
    priority=Priority.INTERACTIVE_HIGH,
    delivery=Delivery.RELIABLE,
    queue=256,
    shared_memory=False,
    max_payload_bytes=64 * KIB,
    owner="event-ingest",
    readers=("frame-capture", "recorder"),
)

# Of its own rather than part of health: the map is needed by programs that compute "now" in event time, to the
# microsecond and at start (hence last_value), whereas health is read by people and may be late or large.
EVENTS_CLOCK: Final[Topic[ClockMessage]] = Topic(
    name="events/clock",
    suffix="events/clock",
    message=ClockMessage,
    rate_hz=2,
    deadline_ms=2000,
    priority=Priority.INTERACTIVE_HIGH,
    delivery=Delivery.NEWEST,
    queue=4,
    shared_memory=False,
    max_payload_bytes=4 * KIB,
    owner="event-ingest",
    readers=("frame-capture", "recorder", "clients"),
    last_value=True,
)

FRAME: Final[Topic[FrameMessage]] = Topic(
    name="frame",
    suffix="frame",
    message=FrameMessage,
    rate_hz=20,
    deadline_ms=0,
    priority=Priority.DATA,
    delivery=Delivery.NEWEST,
    queue=2,
    shared_memory=True,
    max_payload_bytes=64 * MIB,
    owner="frame-capture",
    readers=("segmenter", "recorder"),
)

SEGMENTATION: Final[Topic[SegmentationMessage]] = Topic(
    name="segmentation",
    suffix="segmentation",
    message=SegmentationMessage,
    rate_hz=1,
    deadline_ms=5000,
    priority=Priority.INTERACTIVE_LOW,
    delivery=Delivery.RELIABLE,
    queue=16,
    shared_memory=False,
    max_payload_bytes=16 * MIB,
    owner="segmenter",
    readers=("fusion", "recorder"),
)

TRACK: Final[Topic[TrackMessage]] = Topic(
    name="track",
    suffix="track",
    message=TrackMessage,
    rate_hz=200,
    deadline_ms=50,
    priority=Priority.REAL_TIME,
    delivery=Delivery.NEWEST,
    queue=32,
    shared_memory=False,
    max_payload_bytes=4 * MIB,
    owner="event-tracker",
    readers=("fusion", "recorder"),
)

CORRECTION: Final[Topic[CorrectionMessage]] = Topic(
    name="correction",
    suffix="correction",
    message=CorrectionMessage,
    rate_hz=1,
    deadline_ms=0,
    priority=Priority.INTERACTIVE_HIGH,
    delivery=Delivery.RELIABLE,
    queue=64,
    shared_memory=False,
    max_payload_bytes=4 * MIB,
    owner="fusion",
    readers=("event-tracker", "recorder"),
)

STATE: Final[Topic[StateMessage]] = Topic(
    name="state",
    suffix="state",
    message=StateMessage,
    rate_hz=200,
    deadline_ms=50,
    priority=Priority.REAL_TIME,
    delivery=Delivery.NEWEST,
    queue=32,
    shared_memory=False,
    max_payload_bytes=4 * MIB,
    owner="fusion",
    readers=("event-ingest", "gate", "gateway", "monitor", "recorder", "clients"),
    last_value=True,
)

HEALTH: Final[Topic[HealthMessage]] = Topic(
    name="health",
    suffix="health/{name}",
    message=HealthMessage,
    rate_hz=2,
    deadline_ms=2000,
    priority=Priority.DATA,
    delivery=Delivery.NEWEST,
    queue=64,
    shared_memory=False,
    max_payload_bytes=256 * KIB,
    owner="each daemon",
    readers=("event-ingest", "gate", "monitor", "recorder", "clients"),
    last_value=True,
)

ALIVE: Final[Topic[Message]] = Topic(
    name="alive",
    suffix="alive/{name}",
    message=None,
    rate_hz=0,
    deadline_ms=1000,
    priority=Priority.DATA,
    delivery=Delivery.LIVELINESS,
    queue=64,
    shared_memory=False,
    max_payload_bytes=0,
    owner="each daemon",
    readers=("monitor", "clients"),
)

COMMAND: Final[Topic[CommandRequest]] = Topic(
    name="command",
    suffix="command/{name}",
    message=CommandRequest,
    rate_hz=0,
    deadline_ms=0,
    priority=Priority.INTERACTIVE_LOW,
    delivery=Delivery.QUERY,
    queue=16,
    shared_memory=False,
    max_payload_bytes=256 * KIB,
    owner="clients",
    readers=("each daemon",),
)

TOPICS: Final[tuple[Topic[Any], ...]] = (
    EVENTS_BATCH,
    EVENTS_TRIGGER,
    EVENTS_CLOCK,
    FRAME,
    SEGMENTATION,
    TRACK,
    CORRECTION,
    STATE,
    HEALTH,
    ALIVE,
    COMMAND,
)

_BY_NAME: Final = {row.name: row for row in TOPICS}


def topic(name: str) -> Topic[Any]:
    """The row called ``name``. Raises MotionDLOError if there is none."""
    if name not in _BY_NAME:
        raise MotionDLOError(f"There is no topic {name!r}.", f"Topics: {', '.join(_BY_NAME)}.")
    return _BY_NAME[name]


def all_keys(cell: str) -> str:
    """The key expression of everything in ``cell``."""
    return f"{ROOT}/{cell}/**"


def markdown_table() -> str:
    """The table for the documentation."""
    lines = [
        "| key | from -> to | message | rate | stale after | priority | delivery | queue | shared memory | largest |",
        "|---|---|---|---|---|---|---|---|---|---|",
    ]
    for row in TOPICS:
        name = "<verb>" if row is COMMAND else "<daemon>"
        cells = (
            f"`{row.suffix.format(name=name)}`",
            f"{row.owner} -> {', '.join(row.readers)}",
            row.message.__name__ if row.message else "none",
            f"{row.rate_hz:g} Hz" if row.rate_hz else "on demand",
            f"{row.deadline_ms:g} ms" if row.deadline_ms else "never",
            row.priority.value,
            row.delivery.value + (", last value by query" if row.last_value else ""),
            str(row.queue),
            "when large" if row.shared_memory else "no",
            f"{row.max_payload_bytes // KIB} KiB",
        )
        lines.append(f"| {' | '.join(cells)} |")
    lines.append("")
    lines.append(f"Verbs of `command/<verb>`: {', '.join(f'`{verb}`' for verb in VERBS)}.")
    return "\n".join(lines) + "\n"
