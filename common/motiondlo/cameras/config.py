"""``[cameras]``: the cell's cameras, their drivers and trigger lines."""

from __future__ import annotations

from typing import Literal

from pydantic import BaseModel, ConfigDict, Field, model_validator

Span = tuple[float, float]


class EventCameraSection(BaseModel):
    """``[cameras.event]``."""

    model_config = ConfigDict(frozen=True, extra="forbid", strict=True)

    driver: Literal["", "neuromorphic", "simulated"] = Field(
        default="", description="neuromorphic: EVK4 and other IMX636 cameras by USB; simulated; empty: none"
    )
    serial: str = Field(default="", description="serial number of the camera; empty: the only one there is")
    trigger_channel: int = Field(
        default=0, ge=0, le=15, description="channel of the trigger input that the exposure-active line is wired to"
    )
    bias_diff_on: int = Field(default=0, ge=-85, le=140, description="contrast threshold of ON events, from nominal")
    bias_diff_off: int = Field(default=0, ge=-35, le=190, description="contrast threshold of OFF events, from nominal")
    max_events_per_ms: int = Field(
        default=0, ge=0, le=1_000_000, description="the camera itself drops events beyond this rate; 0: no limit"
    )
    stall_ms: float = Field(
        default=500.0, ge=0.0, le=10_000.0, description="silence after which the camera counts as lost; 0: never"
    )


class FrameCameraSection(BaseModel):
    """``[cameras.frame]``."""

    model_config = ConfigDict(frozen=True, extra="forbid", strict=True)

    driver: Literal["", "genicam", "opencv", "simulated"] = Field(
        default="", description="genicam: GigE Vision, USB3 Vision; opencv: V4L2 and files; simulated; empty: none"
    )
    device: str = Field(
        default="",
        description="genicam: serial number or id, empty for the only one; opencv: /dev/video0, a number or an address",
    )
    producer: str = Field(
        default="", description="genicam: the GenTL producer (.cti); empty: from GENICAM_GENTL64_PATH"
    )
    trigger_source: str = Field(
        default="Line1",
        max_length=64,
        description="genicam: input that starts an exposure; empty: the camera runs free",
    )
    trigger_activation: Literal["RisingEdge", "FallingEdge"] = Field(
        default="RisingEdge", description="genicam: edge of the input that starts an exposure"
    )
    exposure_line: str = Field(
        default="Line2", max_length=64, description="genicam: output that is high during the exposure; empty: none"
    )
    exposure_us: float = Field(default=5000.0, ge=1.0, le=1e6, description="exposure time; opencv: not set")
    gain_db: float = Field(default=0.0, ge=0.0, le=60.0, description="genicam: gain; 0 leaves the camera's own")
    pixel_format: str = Field(default="", max_length=64, description="genicam: PixelFormat; empty: the camera's own")
    width_px: int = Field(default=0, ge=0, le=16384, description="opencv: width to ask for; 0: the camera's own")
    height_px: int = Field(default=0, ge=0, le=16384, description="opencv: height to ask for; 0: the camera's own")
    min_latency_ms: float = Field(
        default=0.0, ge=0.0, le=1000.0, description="a frame arrives at the earliest so long after its trigger"
    )
    max_latency_ms: float = Field(
        default=40.0,
        gt=0.0,
        le=2000.0,
        description="a frame arrives at the latest so long after its trigger; max - min must be less than "
        "min_trigger_interval_ms, unless the camera has a clock of its own",
    )
    min_trigger_interval_ms: float = Field(
        default=45.0, gt=0.0, le=10_000.0, description="triggers are never closer together than this"
    )
    stall_ms: float = Field(
        default=600.0,
        ge=0.0,
        le=10_000.0,
        description="silence after which the camera counts as lost; 0: never (for triggers on demand)",
    )

    @model_validator(mode="after")
    def _latencies_are_ordered(self) -> FrameCameraSection:
        if self.max_latency_ms <= self.min_latency_ms:
            raise ValueError("max_latency_ms above min_latency_ms")
        return self


class SimulatedSection(BaseModel):
    """``[cameras.simulated]``: what simulated cameras see, and which faults befall them."""

    model_config = ConfigDict(frozen=True, extra="forbid", strict=True)

    recording: str = Field(default="", description="folder of the recording that both cameras see, over and over")
    slow_motion: float = Field(default=1.0, ge=1.0, le=100.0, description="the scene moves so many times slower")
    frame_latency_ms: float = Field(
        default=25.0, ge=0.0, le=1000.0, description="a frame arrives so long after the start of its exposure"
    )
    event_unplugged_s: tuple[Span, ...] = Field(
        default=(), description="from, to: the event camera is gone; seconds since it was first opened"
    )
    frame_unplugged_s: tuple[Span, ...] = Field(
        default=(), description="from, to: the RGB camera is gone; seconds since it was first opened"
    )
    dropped_frames: tuple[int, ...] = Field(
        default=(), description="exposures (counted from 0 in each round) whose frame gets lost"
    )
    dropped_triggers: tuple[int, ...] = Field(
        default=(), description="exposures (counted from 0 in each round) whose trigger gets lost"
    )


class CamerasSection(BaseModel):
    """``[cameras]``: of a cell without a recording to replay."""

    model_config = ConfigDict(frozen=True, extra="forbid", strict=True)

    event: EventCameraSection = EventCameraSection()
    frame: FrameCameraSection = FrameCameraSection()
    simulated: SimulatedSection = SimulatedSection()

    @property
    def any(self) -> bool:
        """Whether there is a camera at all."""
        return bool(self.event.driver or self.frame.driver)
