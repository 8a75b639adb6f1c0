"""Boards: what the cables lie on, as reflectance textures in mm; and the belt."""

from __future__ import annotations

import cv2
import numpy as np
import numpy.typing as npt

FloatImage = npt.NDArray[np.float32]

TEXELS_PER_MM = 6
HALF_MM = (170.0, 135.0)
"""Half width and height of the board that is drawn; it reaches past both views."""
BELT_PERIOD_MM = 320.0
BOARD_RGB = {
    "white_paper": (0.70, 0.69, 0.66),
    "green_mat": (0.115, 0.275, 0.19),
    "matte_grey": (0.40, 0.41, 0.42),
    "wood": (0.45, 0.29, 0.155),
    "dark": (0.062, 0.064, 0.068),
    "perforated": (0.50, 0.51, 0.52),
}
"""Mean linear reflectance of every board, red, green, blue."""


def board_texture(kind: str, rng: np.random.Generator) -> FloatImage:
    """Linear reflectance (H, W, 3), RGB order, TEXELS_PER_MM."""
    h, w = (round(2 * half * TEXELS_PER_MM) for half in (HALF_MM[1], HALF_MM[0]))
    painters = {
        "white_paper": _paper,
        "green_mat": _mat,
        "matte_grey": _matte,
        "wood": _wood,
        "dark": _dark,
        "perforated": _perforated,
    }
    image = painters[kind](h, w, rng)
    _stickers(image, rng)
    return np.asarray(np.clip(image, 0.01, 0.95), np.float32)


def _mottled(h: int, w: int, sizes_mm: tuple[float, ...], rng: np.random.Generator) -> FloatImage:
    """Smooth noise (h, w) of unit size, a mix of several scales."""
    total = np.zeros((h, w), np.float32)
    for size in sizes_mm:
        cell = size * TEXELS_PER_MM
        small = rng.normal(0.0, 1.0, (int(h / cell) + 4, int(w / cell) + 4)).astype(np.float32)
        total += cv2.resize(small, (w, h), interpolation=cv2.INTER_CUBIC)
    return np.asarray(total / np.float32(np.sqrt(len(sizes_mm))), np.float32)


def _tinted(grey: FloatImage, rgb: tuple[float, float, float]) -> FloatImage:
    return np.asarray(grey[..., None] * np.asarray(rgb, np.float32), np.float32)


def _paper(h: int, w: int, rng: np.random.Generator) -> FloatImage:
    image = _tinted(1.0 + 0.035 * _mottled(h, w, (1.5, 6.0, 30.0), rng), BOARD_RGB["white_paper"])
    for _ in range(int(rng.integers(12, 22))):
        word = "".join(chr(c) for c in rng.integers(65, 91, 6))
        at = (int(rng.uniform(0, w - 200)), int(rng.uniform(40, h)))
        size = float(rng.choice([0.7, 1.0, 1.5]))
        cv2.putText(image, word, at, cv2.FONT_HERSHEY_DUPLEX, size, (0.14,) * 3, round(2 * size), cv2.LINE_AA)
    return image


def _mat(h: int, w: int, rng: np.random.Generator) -> FloatImage:
    image = _tinted(1.0 + 0.06 * _mottled(h, w, (0.8, 4.0, 40.0), rng), BOARD_RGB["green_mat"])
    pitch = 10 * TEXELS_PER_MM
    shift = rng.integers(0, pitch, 2)
    for axis, size in ((0, h), (1, w)):
        for number, at in enumerate(range(int(shift[axis]), size, pitch // 2)):
            wide = number % 10 == 0
            strength = 1.9 if wide else 1.22 if number % 2 == 0 else 1.1
            line = slice(at, at + (3 if wide else 2))
            if axis == 0:
                image[line] *= strength
            else:
                image[:, line] *= strength
    return image


def _matte(h: int, w: int, rng: np.random.Generator) -> FloatImage:
    return _tinted(1.0 + 0.05 * _mottled(h, w, (1.0, 5.0, 45.0), rng), BOARD_RGB["matte_grey"])


def _wood(h: int, w: int, rng: np.random.Generator) -> FloatImage:
    y = np.arange(h, dtype=np.float32)[:, None] / TEXELS_PER_MM
    x = np.arange(w, dtype=np.float32)[None] / TEXELS_PER_MM
    bent = y + 5.0 * _mottled(h, w, (60.0,), rng) + 0.03 * x
    rings = np.sin(bent * 1.1) + 0.5 * np.sin(bent * 2.7 + 1.0)
    streaks = cv2.GaussianBlur(rng.normal(0.0, 1.0, (h, w)).astype(np.float32), (0, 0), sigmaX=60.0, sigmaY=0.9)
    image = _tinted(1.0 + 0.07 * rings + 0.6 * streaks, BOARD_RGB["wood"])
    for seam in range(int(rng.integers(0, 300)), h, 70 * TEXELS_PER_MM):
        image[seam : seam + 3] *= 0.5
    return image


def _dark(h: int, w: int, rng: np.random.Generator) -> FloatImage:
    return _tinted(1.0 + 0.09 * _mottled(h, w, (0.8, 5.0, 40.0), rng), BOARD_RGB["dark"])


def _perforated(h: int, w: int, rng: np.random.Generator) -> FloatImage:
    image = _tinted(1.0 + 0.03 * _mottled(h, w, (2.0, 30.0), rng), BOARD_RGB["perforated"])
    pitch = 25 * TEXELS_PER_MM
    shift = rng.integers(0, pitch, 2)
    for y in range(int(shift[0]), h + pitch, pitch):
        for x in range(int(shift[1]), w + pitch, pitch):
            cv2.circle(image, (x, y), round(3.1 * TEXELS_PER_MM), (0.33,) * 3, -1, cv2.LINE_AA)
            cv2.circle(image, (x, y), round(2.7 * TEXELS_PER_MM), (0.035,) * 3, -1, cv2.LINE_AA)
    return image


def _stickers(image: FloatImage, rng: np.random.Generator) -> None:
    """A few coloured labels and rings that lie about."""
    h, w = image.shape[:2]
    for _ in range(int(rng.integers(3, 9))):
        colour = tuple(float(c) for c in rng.uniform(0.25, 0.75, 3))
        at = (int(rng.uniform(0.1, 0.9) * w), int(rng.uniform(0.1, 0.9) * h))
        layer = image.copy()
        if rng.random() < 0.5:
            size = (rng.uniform(4, 8) * TEXELS_PER_MM, rng.uniform(8, 14) * TEXELS_PER_MM)
            corners = cv2.boxPoints((at, size, float(rng.uniform(0, 180))))
            cv2.fillConvexPoly(layer, corners.astype(np.int32), colour, cv2.LINE_AA)
        else:
            radius = int(rng.uniform(2, 6) * TEXELS_PER_MM)
            cv2.circle(layer, at, radius, colour, int(rng.uniform(3, 9)), cv2.LINE_AA)
        image += 0.6 * (layer - image)


def belt_texture(half_width_mm: float, rng: np.random.Generator) -> FloatImage:
    """Reflectance (h, w) of one period of the belt, which repeats along x."""
    h, w = round(2 * half_width_mm * TEXELS_PER_MM), round(BELT_PERIOD_MM * TEXELS_PER_MM)
    image = np.asarray(0.095 * (1.0 + 0.08 * _mottled(h, w, (1.0, 6.0), rng)), np.float32)
    for _ in range(70):
        at = (int(rng.uniform(0.02, 0.98) * w), int(rng.uniform(0, h)))
        grey = float(rng.choice([0.03, 0.05, 0.2, 0.3]))
        kind = rng.random()
        if kind < 0.35:
            cv2.circle(image, at, int(rng.uniform(3, 16)), grey, -1, cv2.LINE_AA)
        elif kind < 0.65:
            cv2.circle(image, at, int(rng.uniform(6, 18)), grey, 4, cv2.LINE_AA)
        else:
            angle, length = rng.uniform(0, np.pi), rng.uniform(20, 60)
            end = (int(at[0] + length * np.cos(angle)), int(at[1] + length * np.sin(angle)))
            cv2.line(image, at, end, grey, int(rng.uniform(3, 9)), cv2.LINE_AA)
    return image
