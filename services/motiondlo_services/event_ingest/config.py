"""``[event_ingest]``: how events are cut into batches."""

from __future__ import annotations

from pydantic import BaseModel, ConfigDict, Field


class EventIngestConfig(BaseModel):
    """The event ingest's section."""

    model_config = ConfigDict(frozen=True, extra="forbid", strict=True)

    batch_us: int = Field(
        default=2000, ge=200, le=20_000, description="length of a batch in event time; the tracker updates once a batch"
    )
    max_backlog: int = Field(
        default=50, ge=1, le=10_000, description="batches that may wait to be sent; beyond it the oldest are dropped"
    )
