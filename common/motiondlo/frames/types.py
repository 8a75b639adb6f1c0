"""What the frame branch hands over: one instance per DLO with its curve, width, ends and appearance."""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import StrEnum

import numpy as np
import numpy.typing as npt

FloatArray = npt.NDArray[np.float64]


class EndKind(StrEnum):
    """Why a polyline stops where it stops."""

    TIP = "tip"
    """The DLO's own free end, seen."""
    BORDER = "border"
    """The DLO leaves the image (of either camera)."""
    HELD = "held"
    """It runs into something wide that is no cable, most likely a gripper or clamp."""
    HIDDEN = "hidden"
    """It disappears under something else (a plate, another DLO)."""
    UNKNOWN = "unknown"


@dataclass(frozen=True)
class Appearance:
    """The frame's log-luminance in the DLO's own coordinates ("straightened strip"), sampled in event pixels.

    Row a is at arc length ``s0_px + a * ds_px`` from the first node (negative: before it; rows beyond both ends follow
    the end tangents), column d at the signed offset ``(d - (D - 1) / 2) * dn_px`` along the left normal
    ``(-t_y, t_x)`` of the tangent t. Where the frame does not reach, the border value is repeated and ``known`` is 0.
    """

    strip: npt.NDArray[np.float32]
    """(A, D) natural logarithm of linear luminance (0..1) + 0.02."""
    known: npt.NDArray[np.uint8]
    """(A, D) 1 where the frame has data."""
    s0_px: float
    ds_px: float = 2.0
    dn_px: float = 1.0


@dataclass(frozen=True)
class Instance:
    """One DLO seen in one frame."""

    nodes_rgb: FloatArray
    """(M, 2) rgb px, equidistant along the curve."""
    nodes_event: FloatArray | None
    """(M, 2) event px: ``nodes_rgb`` mapped by ``event_from_rgb``; None without a homography."""
    sigma_px: FloatArray
    """(M,) standard deviation normal to the curve, event px (rgb px without a homography)."""
    width_rgb_px: float
    diameter_px: float
    """Width in event px (equal to ``width_rgb_px`` without a homography)."""
    score: float
    """0..1, how sure the backend is that this is a DLO."""
    ends: tuple[EndKind, EndKind] = (EndKind.UNKNOWN, EndKind.UNKNOWN)
    appearance: Appearance | None = None


@dataclass(frozen=True)
class Segmentation:
    """The result for one frame: instances, or a failure with its reason (then ``instances`` is empty)."""

    t_us: int
    """Trigger time of the frame, event clock."""
    frame_name: str
    instances: tuple[Instance, ...] = field(default_factory=tuple)
    failure: str = ""
    backend: str = ""
    elapsed_ms: float = 0.0
