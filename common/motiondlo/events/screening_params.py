"""Parameters of the screening."""

from __future__ import annotations

from pydantic import BaseModel, ConfigDict, Field


class ScreeningParams(BaseModel):
    """What is kept away from the buckets, or given less trust, before a tracker looks at them."""

    model_config = ConfigDict(frozen=True, strict=True, extra="forbid")

    background: bool = Field(True, description="measure the events that lie everywhere, and expect them at stations")
    background_ms: float = Field(1.0, ge=0.1, le=200.0, description="how slowly it rises; it falls at once")
    learned_regions: bool = Field(True, description="trust places less that make events whatever the DLOs do")
    learned_ms: float = Field(800.0, ge=50.0, le=60_000.0, description="memory of what a place does")
    learned_share: float = Field(
        0.6, ge=0.1, le=1.0, description="share of the time in which such a place makes events"
    )
    learned_most_hz_px: float = Field(
        30.0, ge=0.1, le=1000.0, description="events of such a place that are expected at most, so that a DLO shows"
    )
    flashes: bool = Field(True, description="keep the events of a flash away, and predict meanwhile")
    flash_share: float = Field(0.5, ge=0.1, le=1.0, description="share of the image's tiles that fire at once")
    flash_events: int = Field(64, ge=2, le=1000, description="events of a tile of 16x16 px that count as firing")
    flash_ms: float = Field(4.5, ge=1.0, le=500.0, description="longest flash; what lasts longer is background")
    flicker: bool = Field(True, description="find lamps that flicker, and leave their events out")
    flicker_lowest_hz: float = Field(80.0, ge=20.0, le=200.0, description="lowest frequency of a lamp")
    flicker_highest_hz: float = Field(130.0, ge=20.0, le=200.0, description="highest frequency of a lamp")
    flicker_power: float = Field(0.4, ge=0.1, le=1.0, description="share of the alternation that one sine explains")
    flicker_events: int = Field(
        800, ge=50, le=100_000, description="fewest events of 64x64 px in an eighth of a second that are judged"
    )
    flicker_tolerance: float = Field(0.12, ge=0.01, le=0.3, description="share of a period that a burst may be off")
    hot_pixels: bool = Field(False, description="find pixels that fire without cause, and leave them out")
    hot_hz: float = Field(80.0, ge=1.0, le=100_000.0, description="slower pixels are never called hot")
    hot_ratio: float = Field(8.0, ge=1.5, le=1000.0, description="how much faster than its 8 neighbours")
    hot_limit: int = Field(500, ge=0, le=100_000, description="pixels left out at most")
