"""``[frame_capture]``: pairing of frames with triggers."""

from __future__ import annotations

from pydantic import BaseModel, ConfigDict, Field


class FrameCaptureConfig(BaseModel):
    """The frame capture's section."""

    model_config = ConfigDict(frozen=True, extra="forbid", strict=True)

    pairing_tolerance_us: int = Field(
        default=2000, ge=1, le=1_000_000, description="a frame belongs to a trigger at most this far from its time"
    )
    publish_all: bool = Field(
        default=False, description="publish every frame (for a recorder), not only those asked for"
    )
