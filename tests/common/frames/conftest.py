"""Pictures of cables on boards, drawn with shading, highlight and cast shadow; the truth is known."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import cv2
import numpy as np
import numpy.typing as npt
import pytest
from scipy.spatial import cKDTree

from motiondlo.geometry.curve import left_normals, resample, tangents

FloatArray = npt.NDArray[np.float64]
Image = npt.NDArray[np.uint8]

WIDTH, HEIGHT = 648, 486
_LIGHT = np.array([-0.35, -0.45, 0.82]) / np.linalg.norm([-0.35, -0.45, 0.82])


@dataclass
class Board:
    """A board under construction, linear light, BGR."""

    light: FloatArray
    rng: np.random.Generator
    plate: FloatArray = field(init=False)

    def __post_init__(self) -> None:
        self.plate = self.light.copy()

    def cable(self, points: FloatArray, width: float, bgr: tuple[float, float, float]) -> FloatArray:
        """Draw a cable over everything so far, with its shadow. Returns its dense centreline."""
        centre = resample(points, 400)
        t, n = tangents(centre), left_normals(tangents(centre))
        half = 0.5 * width
        yy, xx = np.mgrid[0 : 2 * HEIGHT, 0 : 2 * WIDTH]
        places = np.stack([(xx.ravel() + 0.5) / 2 - 0.5, (yy.ravel() + 0.5) / 2 - 0.5], axis=1)
        near = cv2.dilate(_stroke(centre), np.ones((int(width) + 5,) * 2, np.uint8))
        chosen = np.flatnonzero(cv2.resize(near, (2 * WIDTH, 2 * HEIGHT), interpolation=cv2.INTER_NEAREST).ravel())
        _, k = cKDTree(centre).query(places[chosen])
        rel = places[chosen] - centre[k]
        across, along = (rel * n[k]).sum(axis=1), (rel * t[k]).sum(axis=1)
        at_end = (k == 0) | (k == len(centre) - 1)
        step = float(np.hypot(*(centre[1] - centre[0])))
        inside = (np.abs(across) < half) & ~(at_end & (np.abs(along) > 0.6 * step))
        v = np.clip(across / half, -1.0, 1.0)
        facing = np.stack([n[k, 0] * v, n[k, 1] * v, np.sqrt(1.0 - v * v)], axis=1) @ _LIGHT
        colour = np.asarray(bgr) * (0.35 + 0.65 * np.clip(facing, 0.0, 1.0))[:, None]
        colour += 0.1 * np.clip(facing, 0.0, 1.0)[:, None] ** 40
        cover = np.zeros(4 * WIDTH * HEIGHT, np.float32)
        paint = np.zeros((4 * WIDTH * HEIGHT, 3), np.float32)
        cover[chosen[inside]] = 1.0
        paint[chosen[inside]] = colour[inside]
        size = (WIDTH, HEIGHT)
        cover = cv2.resize(cover.reshape(2 * HEIGHT, -1), size, interpolation=cv2.INTER_AREA)
        paint = cv2.resize(paint.reshape(2 * HEIGHT, -1, 3), size, interpolation=cv2.INTER_AREA)
        move = np.array([[1.0, 0.0, 0.43 * half], [0.0, 1.0, 0.55 * half]])
        shadow = cv2.GaussianBlur(cv2.warpAffine(cover, move, size), (0, 0), 1.5)
        self.light = self.light * (1.0 - 0.35 * shadow)[..., None]
        self.light = self.light * (1.0 - cover)[..., None] + paint
        return centre

    def box(self, x: int, y: int, w: int, h: int, bgr: tuple[float, float, float]) -> None:
        """Lay a flat rectangle on everything so far (a gripper, a label)."""
        self.light[y : y + h, x : x + w] = bgr

    def photograph(self, exposure: float = 1.0) -> Image:
        """The frame."""
        return self._encode(self.light * exposure)

    def photograph_plate(self) -> Image:
        """The empty board."""
        return self._encode(self.plate)

    def _encode(self, light: FloatArray) -> Image:
        soft = np.clip(cv2.GaussianBlur(light, (0, 0), 0.55), 0.0, 1.0)
        code = np.where(soft <= 0.0031308, soft * 12.92, 1.055 * soft ** (1 / 2.4) - 0.055) * 255.0
        return np.clip(code + self.rng.normal(0.0, 1.0, code.shape), 0, 255).astype(np.uint8)


def _stroke(centre: FloatArray) -> Image:
    mask = np.zeros((HEIGHT, WIDTH), np.uint8)
    cv2.polylines(mask, [np.round(centre).astype(np.int32).reshape(-1, 1, 2)], False, 1, 1)
    return mask


@pytest.fixture
def make_board() -> Callable[[tuple[float, float, float]], Board]:
    """A function that makes a matte board of one colour (linear BGR) with a soft texture; always the same one."""

    def make(bgr: tuple[float, float, float]) -> Board:
        rng = np.random.default_rng(7)
        texture = cv2.GaussianBlur(rng.normal(0.0, 1.0, (HEIGHT, WIDTH)), (0, 0), 8.0)
        texture = 1.0 + 0.02 * texture / texture.std()
        return Board(np.asarray(bgr) * texture[..., None], rng)

    return make


def wave(x0: float, x1: float, y: float, height: float) -> FloatArray:
    """One period of a sine from (x0, y) to (x1, y), (200, 2)."""
    u = np.linspace(0.0, 1.0, 200)
    return np.stack([x0 + (x1 - x0) * u, y + height * np.sin(2 * np.pi * u)], axis=1)


def line(x0: float, y0: float, x1: float, y1: float) -> FloatArray:
    """A straight line, (50, 2)."""
    u = np.linspace(0.0, 1.0, 50)[:, None]
    return np.asarray(np.array([x0, y0]) * (1 - u) + np.array([x1, y1]) * u)


@pytest.fixture
def curves() -> dict[str, Callable[..., FloatArray]]:
    """``wave`` and ``line``."""
    return {"wave": wave, "line": line}
