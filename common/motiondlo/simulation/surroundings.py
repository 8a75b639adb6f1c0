"""What stands still in a camera's image: the lit board, the light's fall-off to the corners, the belt's place."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

from motiondlo.simulation import boards
from motiondlo.simulation.cameras import Camera

FloatImage = npt.NDArray[np.float32]

LIGHT = (-0.35, -0.45, 0.82)
AMBIENT = 0.35
LUMINANCE = (0.299, 0.587, 0.114)


@dataclass(frozen=True)
class Surroundings:
    """Per camera; C is 1 (luminance) for the event camera and 3 (RGB) for the frames."""

    board: FloatImage
    """(H, W, C) linear light."""
    light_map: FloatImage
    """(H, W) of a white surface that faces up, over that of one that faces the light."""
    belt_along: FloatImage
    """(H, W) mm."""
    belt_across: FloatImage
    """(H, W) mm from the belt's edge."""
    belt_inside: FloatImage
    """(H, W) coverage."""


def light_direction() -> npt.NDArray[np.float64]:
    """Unit vector to the light."""
    light = np.asarray(LIGHT)
    return np.asarray(light / np.linalg.norm(light))


def see(camera: Camera, texture: FloatImage, colour: bool, belt_y_mm: float, belt_half_mm: float) -> Surroundings:
    """The board's texture (linear RGB, boards.TEXELS_PER_MM) as this camera sees it."""
    texel_mm = 1.0 / boards.TEXELS_PER_MM
    mm_from_texel = np.array([[texel_mm, 0, -boards.HALF_MM[0]], [0, texel_mm, -boards.HALF_MM[1]], [0, 0, 1.0]])
    pixel_from_mm = camera.image_from_plane(0.0)
    size = (camera.width, camera.height)
    source = texture if colour else (texture @ np.asarray(LUMINANCE, np.float32))
    image = cv2.warpPerspective(
        source, pixel_from_mm @ mm_from_texel, size, flags=cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE
    )
    image = cv2.GaussianBlur(image, (0, 0), camera.blur_px).reshape(camera.height, camera.width, -1)
    y, x = np.mgrid[0 : camera.height, 0 : camera.width].astype(np.float64)
    radius = np.hypot(x - camera.centre_px[0], y - camera.centre_px[1]) / (0.5 * camera.width)
    light_map = (1.0 - 0.24 * radius**2 / (1.0 + 0.3 * radius**2)).astype(np.float32)
    facing = AMBIENT + (1.0 - AMBIENT) * float(light_direction()[2])
    places = np.stack([x, y, np.ones_like(x)], axis=-1) @ np.linalg.inv(pixel_from_mm).T
    along = places[..., 0] / places[..., 2]
    across = places[..., 1] / places[..., 2] - belt_y_mm + belt_half_mm
    edge = np.minimum(across, 2.0 * belt_half_mm - across) * camera.focal_px / camera.centre_mm[2]
    return Surroundings(
        board=np.ascontiguousarray(image * (light_map * facing)[..., None], dtype=np.float32),
        light_map=light_map,
        belt_along=along.astype(np.float32),
        belt_across=across.astype(np.float32),
        belt_inside=np.clip(edge + 0.5, 0.0, 1.0).astype(np.float32),
    )
