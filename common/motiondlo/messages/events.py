"""Events and triggers as ingest publishes them, and the clock that relates both to the host."""

from __future__ import annotations

from typing import Annotated, Any, ClassVar, Final, Self

import numpy as np
from pydantic import Field, model_validator
from pydantic_core import PydanticCustomError

from motiondlo.events.types import EVENT_DTYPE, TRIGGER_DTYPE, EventBatch, empty_events, empty_triggers
from motiondlo.messages.arrays import Array, ArraySpec, wire_dtype
from motiondlo.messages.bulk import BulkMessage
from motiondlo.messages.event_kernels import IN_ORDER, OUT_OF_TIME, check_words
from motiondlo.messages.header import Count, Message, TimeNs, TimeUs, trusted
from motiondlo.messages.reject import Rejected
from motiondlo.rejects import RejectReason

MAX_EVENTS: Final = 1 << 20
"""Events of one batch (16 MiB)."""
MAX_TRIGGERS: Final = 1024
SENSOR_MAX_PX: Final = 1 << 16

EVENTS_SPEC: Final = ArraySpec(EVENT_DTYPE, (None,), MAX_EVENTS)
TRIGGERS_SPEC: Final = ArraySpec(TRIGGER_DTYPE, (None,), MAX_TRIGGERS)
_NO_TRIGGERS: Final = {"dtype": wire_dtype(TRIGGER_DTYPE), "shape": (0,), "data": b""}

Pixels = Annotated[int, Field(ge=1, le=SENSOR_MAX_PX)]


def check_events(events: Array, t0_us: int, t1_us: int, width_px: int, height_px: int) -> None:
    """Raises Rejected: TIME_BACKWARDS (out of order or outside [t0, t1)), OUT_OF_SENSOR (also polarity above 1)."""
    words = events.view(np.int64).reshape(-1, 2)
    code = check_words(words, t0_us, t1_us, width_px, height_px)
    if code == IN_ORDER:
        return
    if code == OUT_OF_TIME:
        raise Rejected(RejectReason.TIME_BACKWARDS, f"events out of order or outside [{t0_us}, {t1_us}) us")
    raise Rejected(RejectReason.OUT_OF_SENSOR, f"events outside {width_px}x{height_px} px or with a polarity above 1")


class EventBatchMessage(BulkMessage):
    """All events with t0_us <= t < t1_us; ``t_us`` of the header equals ``t1_us``. Empty batches are sent too."""

    bulk_key: ClassVar[str] = "events"

    t0_us: TimeUs
    t1_us: TimeUs
    lost_before: Annotated[Count, Field(description="Batches known to be missing before this one.")] = 0
    t_ingest_ns: Annotated[TimeNs, Field(description="When the newest event entered the system.")] = 0
    width_px: Pixels = 1280
    height_px: Pixels = 720
    triggers: Annotated[Array, TRIGGERS_SPEC] = Field(default_factory=empty_triggers)
    n: Annotated[int, Field(ge=0, le=MAX_EVENTS, description="Number of events.")] = 0
    events: Annotated[Array, EVENTS_SPEC] = Field(default_factory=empty_events)

    @model_validator(mode="after")
    def _consistent(self) -> Self:
        try:
            _check_batch(self.t0_us, self.t1_us, self.n, self.width_px, self.height_px, self.events)
        except Rejected as rejected:
            raise PydanticCustomError(rejected.reason.value, "{detail}", {"detail": rejected.detail}) from None
        return self

    @classmethod
    def prepare(cls) -> None:
        """Compile the check of events for writable and for read-only arrays."""
        for events in (empty_events(), np.frombuffer(b"", EVENT_DTYPE)):
            check_events(events, 0, 1, 1, 1)

    @classmethod
    def from_batch(
        cls, batch: EventBatch, t_ingest_ns: int, width_px: int = 1280, height_px: int = 720, valid: bool = True
    ) -> Self:
        """The message of a batch whose newest event entered the system at ``t_ingest_ns``.

        The batch is trusted (its maker has checked it); its arrays are not copied.
        """
        return trusted(
            cls,
            {
                "t_us": batch.t1_us,
                "valid": valid,
                "t0_us": batch.t0_us,
                "t1_us": batch.t1_us,
                "lost_before": batch.lost_before,
                "t_ingest_ns": t_ingest_ns,
                "width_px": width_px,
                "height_px": height_px,
                "triggers": batch.triggers,
                "n": len(batch.events),
                "events": batch.events,
            },
        )

    def to_batch(self, lost_on_the_way: int = 0) -> EventBatch:
        """The batch; to the losses that the sender knows of, the reader adds those it saw as gaps in the sequence."""
        return EventBatch(self.t0_us, self.t1_us, self.events, self.triggers, self.lost_before + lost_on_the_way)

    def small_fields(self) -> dict[str, Any]:
        """All but header and events."""
        return {
            "t0_us": self.t0_us,
            "t1_us": self.t1_us,
            "lost_before": self.lost_before,
            "t_ingest_ns": self.t_ingest_ns,
            "width_px": self.width_px,
            "height_px": self.height_px,
            "triggers": TRIGGERS_SPEC.pack(self.triggers) if len(self.triggers) else _NO_TRIGGERS,
            "n": self.n,
        }


def _check_batch(t0_us: int, t1_us: int, n: int, width_px: int, height_px: int, events: Array) -> None:
    if t1_us <= t0_us:
        raise Rejected(RejectReason.TIME_BACKWARDS, f"batch from {t0_us} to {t1_us} us")
    if n != len(events):
        raise Rejected(RejectReason.WRONG_SHAPE, f"n is {n}, but there are {len(events)} events")
    check_events(events, t0_us, t1_us, width_px, height_px)


class TriggerMessage(Message):
    """Edges on the event camera's trigger input; ``t_us`` of the header is the newest edge's time."""

    triggers: Annotated[Array, TRIGGERS_SPEC]
    t_ingest_ns: TimeNs = 0


class ClockMessage(Message):
    """The event clock on the host's: ``anchor_host_ns + (t_us - anchor_us) * 1000 * (1 + drift_ppm * 1e-6)``."""

    anchor_us: TimeUs
    anchor_host_ns: TimeNs
    drift_ppm: Annotated[float, Field(ge=-1e6, le=1e6, description="How much faster the host's clock runs.")] = 0.0
    sigma_us: Annotated[float, Field(ge=0.0, description="Standard deviation of the mapping at the anchor.")] = 0.0
    epoch: Annotated[Count, Field(description="Counts up when the event clock starts anew.")] = 0
    steps: Annotated[Count, Field(description="Steps of the event clock found so far.")] = 0
    wraps: Annotated[Count, Field(description="24-bit wraps of the camera's clock bridged so far.")] = 0

    def host_ns(self, t_us: int) -> int:
        """Host monotonic time, ns, of the event time ``t_us``."""
        return self.anchor_host_ns + round((t_us - self.anchor_us) * 1000 * (1.0 + self.drift_ppm * 1e-6))

    def event_us(self, host_ns: int) -> int:
        """Event time, us, of the host monotonic time ``host_ns``."""
        return self.anchor_us + round((host_ns - self.anchor_host_ns) / (1000 * (1.0 + self.drift_ppm * 1e-6)))
