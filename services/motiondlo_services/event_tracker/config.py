"""``[event_tracker]``: which tracker, with which parameters."""

from __future__ import annotations

from typing import Literal

from pydantic import BaseModel, ConfigDict, Field, field_validator

from motiondlo.events.screening_regions import MOST_REGIONS, wrong_region
from motiondlo.tracking.backlog import MOST_MERGED, MOST_WAITING, PATIENCE
from motiondlo_services.event_tracker.core import MOST_EVENTS


class EventTrackerConfig(BaseModel):
    """The event tracker's section."""

    model_config = ConfigDict(frozen=True, extra="forbid", strict=True)

    profile: Literal["default", "paper"] = Field(default="default", description="the tracker and its parameter set")
    parameters: dict[str, bool | int | float | str] = Field(
        default_factory=dict, description="parameters of the profile that this cell changes"
    )
    regions: dict[str, tuple[float, ...]] = Field(
        default_factory=dict,
        max_length=MOST_REGIONS,
        description="parts of the event image that are left out, by name: x0, y0, x1, y1, or x, y of each corner, px",
    )
    patience: int = Field(
        default=PATIENCE,
        ge=1,
        le=1000,
        description="so many waiting batches are published one by one; more share a publication",
    )
    most_merged: int = Field(
        default=MOST_MERGED, ge=1, le=100, description="one publication takes no more waiting batches than this"
    )
    most_waiting: int = Field(
        default=MOST_WAITING,
        ge=1,
        le=10_000,
        description="beyond so many waiting batches the oldest are dropped, and counted",
    )
    most_events: int = Field(
        default=MOST_EVENTS,
        ge=100,
        le=1_000_000,
        description="while several batches wait, those with more events are thinned to about so many, and counted",
    )

    @field_validator("regions")
    @classmethod
    def _sound(cls, regions: dict[str, tuple[float, ...]]) -> dict[str, tuple[float, ...]]:
        for name, corners in regions.items():
            wrong = wrong_region(corners)
            if wrong:
                raise ValueError(f"{name}: {wrong}")
        return regions
