"""A scene: what moves on which board, and how. What is left open is drawn by the seed."""

from __future__ import annotations

from typing import Literal

from pydantic import BaseModel, ConfigDict, Field

CableKind = Literal["tube", "printed", "cord", "wire"]
BoardKind = Literal["white_paper", "green_mat", "matte_grey", "wood", "dark", "perforated"]
Direction = Literal["across", "along", "any"]
Shape = Literal["any", "straight", "arc", "wave", "loop"]


class _Strict(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid", strict=True)


class CableParams(_Strict):
    """``[[cables]]``: one DLO. Without a gripper it lies on the board."""

    kind: CableKind = Field(
        default="tube", description="glossy tube, cable with printing, matte cord, or thin stiff wire"
    )
    diameter_mm: float | None = Field(default=None, ge=0.4, le=20.0, description="absent: usual for its kind")
    length_mm: float | None = Field(default=None, ge=30.0, le=400.0, description="absent: drawn")
    rgb: tuple[float, float, float] | None = Field(
        default=None, description="linear reflectance 0..1, red, green, blue; absent: drawn"
    )
    shape: Shape = Field(default="any", description="family of its resting shape")
    gripper: int = Field(default=-1, ge=-1, le=7, description="index of the gripper that holds it; -1: none")
    offset_mm: float = Field(
        default=0.0, ge=-80.0, le=80.0, description="across the gripper, from its middle to where it is held"
    )
    fan_deg: float = Field(
        default=0.0, ge=-90.0, le=90.0, description="angle between the gripper's axis and the cable where it is held"
    )
    support_mm: float = Field(
        default=0.0, ge=0.0, le=30.0, description="height of the plane on which it slides; 7 lifts it over others"
    )
    loose: bool = Field(default=False, description="lies on the board unheld, in the way of the first gripper")


class StrokeParams(_Strict):
    """``[[grippers.strokes]]``: a movement from rest to rest."""

    distance_mm: float | None = Field(default=None, ge=1.0, le=300.0, description="absent: drawn")
    mean_speed_mm_s: float | None = Field(
        default=None, ge=20.0, le=3000.0, description="distance over duration; absent: the scene's speed_mm_s"
    )
    direction: Direction = Field(default="across", description="relative to the cable at the gripper and its chord")
    turn_deg: float | None = Field(
        default=None, ge=-90.0, le=90.0, description="the gripper turns by this much; absent: drawn, small"
    )
    back: bool = Field(default=False, description="return to where the previous stroke began")
    delay_s: float = Field(default=0.0, ge=0.0, le=5.0, description="rest before it")


class GripperParams(_Strict):
    """``[[grippers]]``: what holds one cable or several, and moves."""

    strokes: tuple[StrokeParams, ...] = Field(default=(StrokeParams(),), description="movements, one after another")
    scale: float = Field(default=1.0, ge=0.3, le=2.0, description="size, relative to a parallel gripper of 22 mm")
    bar_mm: float = Field(
        default=0.0, ge=0.0, le=200.0, description="width of a clamp bar that holds several cables; 0: two fingers"
    )


class PlateParams(_Strict):
    """``[plate]``: a metal plate above the cables."""

    half_width_mm: float = Field(default=13.0, ge=3.0, le=60.0, description="half of its narrow side")
    height_mm: float = Field(default=15.0, ge=8.0, le=50.0, description="its top, above the board")


class BeltParams(_Strict):
    """``[belt]``: a strip with marks that runs under the cables all the time."""

    half_width_mm: float = Field(default=15.0, ge=3.0, le=60.0, description="half of its width")
    speed_mm_s: float = Field(default=110.0, ge=-500.0, le=500.0, description="along x")


class FlickerParams(_Strict):
    """``[flicker]``: a lamp on the mains that lights part of the board."""

    amplitude: float = Field(default=0.19, ge=0.0, le=0.9, description="of the light, relative, in the spot's middle")
    hz: float = Field(default=100.0, ge=1.0, le=2000.0, description="frequency of the light")
    radius_mm: float = Field(default=30.0, ge=5.0, le=300.0, description="size of the spot (standard deviation)")


class FlashParams(_Strict):
    """``[flash]``: one flash of light over everything."""

    start_s: float = Field(default=0.34, ge=0.0, le=60.0, description="when it begins")
    decay_s: float = Field(default=0.035, ge=0.001, le=2.0, description="time constant of its decay")
    amplitude: float = Field(default=0.45, ge=0.0, le=5.0, description="of the light, relative")


class SensorParams(_Strict):
    """``[sensor]``: the pixels of the event camera."""

    threshold_on: float = Field(default=0.40, ge=0.05, le=2.0, description="change of log intensity for a rising event")
    threshold_off: float = Field(default=0.38, ge=0.05, le=2.0, description="and for a falling one")
    mismatch: float = Field(default=0.03, ge=0.0, le=0.2, description="of thresholds from pixel to pixel (1 sigma)")
    jitter: float = Field(default=0.012, ge=0.0, le=0.2, description="of thresholds from event to event (1 sigma)")
    refractory_us: float = Field(default=900.0, ge=0.0, le=10000.0, description="dead time of a pixel after an event")
    refractory_mismatch: float = Field(default=0.25, ge=0.0, le=0.9, description="of the dead time, relative")
    row_period_us: int = Field(default=24, ge=1, le=1000, description="a row is read out at multiples of this")
    tau_us: float = Field(default=80.0, ge=0.0, le=5000.0, description="photoreceptor's time constant, white board")
    noise_hz: float = Field(default=0.12, ge=0.0, le=50.0, description="background activity per pixel")
    noise_on_share: float = Field(default=0.6, ge=0.0, le=1.0, description="share of rising events in it")
    hot_pixels: int = Field(default=25, ge=0, le=10000, description="number of pixels that fire all the time")
    hot_hz: float = Field(default=400.0, ge=0.0, le=5000.0, description="mean rate of a hot pixel")


class SceneParams(_Strict):
    """A scene file (TOML)."""

    summary: str = Field(default="", description="one line for people")
    board: BoardKind | None = Field(default=None, description="absent: drawn")
    speed_mm_s: float | None = Field(
        default=None, ge=20.0, le=3000.0, description="mean speed of strokes; absent: drawn, 90 to 1500"
    )
    rest_before_s: float = Field(default=0.3, ge=0.05, le=10.0, description="rest before the first stroke")
    rest_after_s: float = Field(default=0.4, ge=0.05, le=10.0, description="after the end of the last one")
    cables: tuple[CableParams, ...] = Field(min_length=1, max_length=12, description="the DLOs, lower ones first")
    grippers: tuple[GripperParams, ...] = Field(default=(), max_length=8, description="what moves them")
    plate: PlateParams | None = Field(default=None, description="absent: none")
    belt: BeltParams | None = Field(default=None, description="absent: none")
    flicker: FlickerParams | None = Field(default=None, description="absent: none")
    flash: FlashParams | None = Field(default=None, description="absent: none")
    sensor: SensorParams = Field(default=SensorParams(), description="the event camera's pixels")
