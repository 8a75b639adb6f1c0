"""Pinhole cameras above the board. World: mm, x right, y down, z up from the board; pixel centres are integers."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

FloatArray = npt.NDArray[np.float64]

WORK_PLANE_MM = 3.0


@dataclass(frozen=True)
class Camera:
    """A camera that looks down."""

    width: int
    height: int
    focal_px: float
    centre_px: tuple[float, float]
    centre_mm: tuple[float, float, float]
    tilt_rad: tuple[float, float]
    roll_rad: float
    blur_px: float

    def project(self, points: FloatArray) -> FloatArray:
        """World points (..., 3) in mm to pixels (..., 2)."""
        seen = (points - np.asarray(self.centre_mm)) @ self._camera_from_world().T
        return np.asarray(self.focal_px * seen[..., :2] / seen[..., 2:] + np.asarray(self.centre_px))

    def scale(self, height_mm: FloatArray) -> FloatArray:
        """Pixels per mm at heights (...,) above the board, near the image's middle."""
        return np.asarray(self.focal_px / (self.centre_mm[2] - height_mm))

    def image_from_plane(self, height_mm: float) -> FloatArray:
        """Homography (3, 3) from (x, y) in mm on the plane at ``height_mm`` to pixels."""
        r = self._camera_from_world()
        to_camera = np.stack([r[:, 0], r[:, 1], r @ (np.array([0.0, 0.0, height_mm]) - np.asarray(self.centre_mm))], 1)
        inner = np.array(
            [[self.focal_px, 0.0, self.centre_px[0]], [0.0, self.focal_px, self.centre_px[1]], [0.0, 0.0, 1.0]]
        )
        h = inner @ to_camera
        return np.asarray(h / h[2, 2])

    def _camera_from_world(self) -> FloatArray:
        ax, ay = self.tilt_rad
        cx, sx, cy, sy, cr, sr = np.cos(ax), np.sin(ax), np.cos(ay), np.sin(ay), np.cos(self.roll_rad), 0.0
        sr = np.sin(self.roll_rad)
        down = np.diag([1.0, 1.0, -1.0])
        about_x = np.array([[1.0, 0.0, 0.0], [0.0, cx, -sx], [0.0, sx, cx]])
        about_y = np.array([[cy, 0.0, -sy], [0.0, 1.0, 0.0], [sy, 0.0, cy]])
        about_z = np.array([[cr, -sr, 0.0], [sr, cr, 0.0], [0.0, 0.0, 1.0]])
        return np.asarray(about_z @ about_y @ about_x @ down)


def draw_cameras(rng: np.random.Generator) -> tuple[Camera, Camera]:
    """Event camera (1280 x 720, 5.4 px/mm on the work plane) and RGB camera (1296 x 972) as mounted this time."""
    event = Camera(
        width=1280,
        height=720,
        focal_px=1234.57,
        centre_px=(639.5 + rng.normal(0.0, 5.0), 359.5 + rng.normal(0.0, 5.0)),
        centre_mm=(0.0, 0.0, 231.62),
        tilt_rad=(rng.normal(0.0, 0.006), rng.normal(0.0, 0.006)),
        roll_rad=rng.normal(0.0, 0.01),
        blur_px=0.7,
    )
    x_mm = rng.normal(28.5, 2.5)
    rgb = Camera(
        width=1296,
        height=972,
        focal_px=1363.6,
        centre_px=(647.5 + rng.normal(0.0, 5.0), 485.5 + rng.normal(0.0, 5.0)),
        centre_mm=(x_mm, rng.normal(-2.0, 2.5), 271.0),
        # It stands aside and looks at the same place.
        tilt_rad=(rng.normal(0.0, 0.008), -np.arctan2(x_mm, 271.0) + rng.normal(0.0, 0.006)),
        roll_rad=rng.normal(0.0, 0.012),
        blur_px=0.55,
    )
    return event, rgb


def event_from_rgb(event: Camera, rgb: Camera) -> FloatArray:
    """The exact homography (3, 3) on the work plane."""
    h = event.image_from_plane(WORK_PLANE_MM) @ np.linalg.inv(rgb.image_from_plane(WORK_PLANE_MM))
    return np.asarray(h / h[2, 2])


def calibrated_homography(
    event: Camera, rgb: Camera, rng: np.random.Generator, points: int = 24
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """As a person calibrates: fitted to noisy points. Returns (3, 3), the RGB points and the event points (n, 2)."""
    exact = np.linalg.inv(event_from_rgb(event, rgb))
    seen = np.stack([rng.uniform(30, event.width - 30, points), rng.uniform(30, event.height - 30, points)], axis=1)
    rgb_px = cv2.perspectiveTransform(seen[None], exact)[0]
    event_px = seen + rng.normal(0.0, 0.72, seen.shape)
    fitted, _ = cv2.findHomography(rgb_px, event_px, 0)
    return np.asarray(fitted / fitted[2, 2], dtype=np.float64), rgb_px, event_px
