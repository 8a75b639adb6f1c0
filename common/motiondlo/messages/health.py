"""What a daemon says about itself, twice a second and on change."""

from __future__ import annotations

from typing import Annotated, Final, Literal

from pydantic import Field

from motiondlo.messages.header import Count, Message, Name, ShortText, WireModel
from motiondlo.messages.segmentation import NotNegative

MAX_ENTRIES: Final = 256

Key = Annotated[str, Field(max_length=200)]
Scalar = bool | int | float | ShortText
Counts = Annotated[dict[Key, Count], Field(max_length=MAX_ENTRIES)]
Numbers = Annotated[dict[Key, float], Field(max_length=MAX_ENTRIES)]
Texts = Annotated[dict[Key, ShortText], Field(max_length=MAX_ENTRIES)]


class Quantiles(WireModel):
    """A distribution since the last health message, milliseconds."""

    p50: NotNegative
    p99: NotNegative
    max: NotNegative


class HealthMessage(Message):
    """``t_us`` of the header is the newest event time that the daemon knows, -1 for none."""

    daemon: Name
    lifecycle: Literal["starting", "running", "degraded", "stopping"]
    ready: bool
    uptime_s: NotNegative
    pid: Count = 0
    problems: Annotated[
        tuple[ShortText, ...], Field(max_length=64, description="Sentences: what is wrong, what to do.")
    ] = ()
    rates_hz: Annotated[Numbers, Field(description="Per input and output.")] = Field(default_factory=dict)
    latencies_ms: Annotated[dict[Key, Quantiles], Field(max_length=MAX_ENTRIES)] = Field(default_factory=dict)
    drops: Annotated[Counts, Field(description="Per topic: missing sequence numbers, repeats, full queues.")] = Field(
        default_factory=dict
    )
    rejects: Annotated[Counts, Field(description="Per reason.")] = Field(default_factory=dict)
    reject_senders: Annotated[Counts, Field(description="Per sender:reason.")] = Field(default_factory=dict)
    queues: Annotated[Counts, Field(description="Depth per input.")] = Field(default_factory=dict)
    versions: Texts = Field(default_factory=dict)
    info: Annotated[dict[Key, Scalar], Field(max_length=MAX_ENTRIES, description="Anything else.")] = Field(
        default_factory=dict
    )
