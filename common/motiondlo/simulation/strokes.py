"""How a gripper moves from rest to rest."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

FloatArray = npt.NDArray[np.float64]

_BELL_MEAN = 8.0 / 15.0


@dataclass(frozen=True)
class Stroke:
    """A movement along a straight line, with a turn."""

    start_s: float
    duration_s: float
    move_mm: tuple[float, float]
    turn_rad: float
    cruise: float = 0.0
    """Share of the time at full speed in the middle; 0 gives the minimum-jerk movement."""


def progress(tau: FloatArray, cruise: float) -> FloatArray:
    """Share of the way at the share ``tau`` of the time: the halves of a minimum-jerk movement around a cruise.

    tau: any shape, clipped to 0..1. Returns the same shape.
    """
    tau = np.clip(tau, 0.0, 1.0)
    ramp = 1.0 - cruise
    peak = 1.0 / (cruise + ramp * _BELL_MEAN)
    early = np.minimum(tau, 0.5 * ramp) / ramp
    late = 0.5 + np.maximum(tau - (1.0 - 0.5 * ramp), 0.0) / ramp
    middle = np.clip(tau - 0.5 * ramp, 0.0, cruise)
    rise = _quintic(early) + (_quintic(late) - 0.5)
    return np.asarray(peak * (_BELL_MEAN * ramp * rise + middle))


def _quintic(x: FloatArray) -> FloatArray:
    return np.asarray(x**3 * (10.0 + x * (6.0 * x - 15.0)))


def gripper_poses(start: tuple[float, float, float], strokes: tuple[Stroke, ...], times_s: FloatArray) -> FloatArray:
    """Pose (T, 3) at the times (T,): x and y in mm, angle in rad."""
    poses = np.tile(np.asarray(start, dtype=np.float64), (len(times_s), 1))
    for stroke in strokes:
        share = progress((times_s - stroke.start_s) / stroke.duration_s, stroke.cruise)
        poses += share[:, None] * np.array([*stroke.move_mm, stroke.turn_rad])
    return poses
