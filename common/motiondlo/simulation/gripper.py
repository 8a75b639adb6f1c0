"""The gripper as parts: where they are, and how they look from above."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

from motiondlo.simulation.cameras import Camera
from motiondlo.simulation.plan import GripperPlan

FloatArray = npt.NDArray[np.float64]
Texture = npt.NDArray[np.float32]

TEXELS_PER_MM = 6


@dataclass(frozen=True)
class Part:
    """A flat rectangle above the board that moves with the gripper."""

    along_mm: float
    """Centre, along the direction in which cables leave; 0 where they are held."""
    across_mm: float
    half_length_mm: float
    half_width_mm: float
    height_mm: float
    """Of its top above what is held."""
    grey: float
    """Linear reflectance."""


def gripper_parts(gripper: GripperPlan) -> tuple[Part, ...]:
    """Parts from the lowest to the highest."""
    s = gripper.scale
    if gripper.bar_mm > 0.0:
        half = 0.5 * gripper.bar_mm
        return (
            Part(-5.5 * s, 0.0, 7.0 * s, half, 4.0, 0.20),
            Part(-17.3 * s, 0.0, 9.0 * s, 9.5 * s, 9.0, 0.17),
            Part(-51.0 * s, 0.0, 28.0 * s, 7.6 * s, 12.0, 0.62),
        )
    return (
        Part(-3.2 * s, 0.0, 4.2 * s, 6.9 * s, 3.5, 0.33),
        Part(-1.2 * s, 5.0 * s, 7.5 * s, 1.85 * s, 5.0, 0.42),
        Part(-1.2 * s, -5.0 * s, 7.5 * s, 1.85 * s, 5.0, 0.42),
        Part(-17.3 * s, 0.0, 11.1 * s, 9.4 * s, 9.0, 0.16),
        Part(-51.0 * s, 0.0, 27.5 * s, 7.7 * s, 11.0, 0.62),
    )


def part_texture(part: Part, rng: np.random.Generator) -> Texture:
    """Reflectance (h, w) of a part, x along it: brushed metal, a groove, screws, a bevel."""
    w = max(8, round(2 * part.half_length_mm * TEXELS_PER_MM))
    h = max(8, round(2 * part.half_width_mm * TEXELS_PER_MM))
    brushed = cv2.GaussianBlur(rng.normal(0.0, 1.0, (h, w)).astype(np.float32), (0, 0), sigmaX=12.0, sigmaY=0.8)
    image = np.full((h, w), part.grey, np.float32) * (1.0 + 0.25 * brushed)
    image *= np.linspace(0.88, 1.12, h, dtype=np.float32)[:, None]
    groove = max(1, round(0.5 * TEXELS_PER_MM))
    image[h // 2 - groove : h // 2 + groove] *= 0.62
    radius = max(2, round(min(1.0, 0.3 * part.half_width_mm) * TEXELS_PER_MM))
    for x in (0.15, 0.5, 0.85) if part.half_length_mm > 20 else (0.18, 0.82):
        for y in (0.24, 0.76):
            cv2.circle(image, (round(x * w), round(y * h)), radius, float(0.3 * part.grey), -1, cv2.LINE_AA)
    edge = max(1, round(0.25 * TEXELS_PER_MM))
    image[:edge] *= 1.25
    image[-edge:] *= 0.75
    return np.asarray(image, np.float32)


def part_centres(parts: tuple[Part, ...], pose: FloatArray, held_mm: float) -> FloatArray:
    """World places (B, 3) of the middles of the parts' tops. pose: (3,) x, y, direction; held_mm: the axis' height."""
    c, s = np.cos(pose[2]), np.sin(pose[2])
    return np.array(
        [
            (
                pose[0] + c * part.along_mm - s * part.across_mm,
                pose[1] + s * part.along_mm + c * part.across_mm,
                held_mm + part.height_mm,
            )
            for part in parts
        ]
    )


def box_px(camera: Camera, centre: FloatArray, angle_rad: float, half_mm: tuple[float, float]) -> FloatArray:
    """A rectangle at a height as seen: centre x, y, angle, half length, half width, texels' scale (6,)."""
    ahead = centre + np.array([np.cos(angle_rad), np.sin(angle_rad), 0.0])
    pixels = camera.project(np.stack([centre, ahead]))
    along = pixels[1] - pixels[0]
    scale = float(np.hypot(*along))
    return np.array(
        [*pixels[0], np.arctan2(along[1], along[0]), scale * half_mm[0], scale * half_mm[1], scale * TEXELS_PER_MM]
    )
