"""Anti-aliased strokes, bands and labels on an image; coordinates are pixels of that image (pixel centres integer)."""

from __future__ import annotations

import cv2
import numpy as np
import numpy.typing as npt

from motiondlo.drawing.palette import BLACK, WHITE, Colour

FloatArray = npt.NDArray[np.float64]
Image = npt.NDArray[np.uint8]

_SHIFT = 4  # cv2 takes fixed-point coordinates: 1/16 px
_LIMIT_PX = 1e5  # beyond this a coordinate would overflow; far outside any image anyway
_MAX_DASHES = 1000


def stroke_width(image: Image) -> int:
    """Line width that is legible at the image's size."""
    return max(1, round(int(max(image.shape[:2])) / 480))


def draw_line(image: Image, points: FloatArray, colour: Colour, width: int, outline: bool = True) -> None:
    """A polyline (N, 2), with a dark outline that separates it from any background. Draws in place."""
    fixed = [_fixed(points)]
    if outline:
        cv2.polylines(image, fixed, False, BLACK, width + 2, cv2.LINE_AA, _SHIFT)
    cv2.polylines(image, fixed, False, colour, width, cv2.LINE_AA, _SHIFT)


def draw_dashes(image: Image, points: FloatArray, colour: Colour, width: int, dash_px: float = 8.0) -> None:
    """A dashed polyline (N, 2): dashes of ``dash_px``, gaps of the same length. Draws in place."""
    steps = np.hypot(*np.diff(points, axis=0).T)
    s = np.concatenate([[0.0], np.cumsum(steps)])
    dash_px = max(dash_px, s[-1] / _MAX_DASHES)
    for start in np.arange(0.0, s[-1], 2.0 * dash_px):
        at = np.linspace(start, min(start + dash_px, s[-1]), 4)
        draw_line(
            image,
            np.stack([np.interp(at, s, points[:, 0]), np.interp(at, s, points[:, 1])], axis=1),
            colour,
            width,
            outline=False,
        )


def draw_dots(image: Image, points: FloatArray, colour: Colour, radius_px: float) -> None:
    """Filled dots with a dark rim at (N, 2). Draws in place."""
    for centre in _fixed(points):
        for colour_now, radius in ((BLACK, radius_px + 1.0), (colour, radius_px)):
            cv2.circle(
                image,
                (int(centre[0]), int(centre[1])),
                round(radius * (1 << _SHIFT)),
                colour_now,
                cv2.FILLED,
                cv2.LINE_AA,
                _SHIFT,
            )


def shade_band(image: Image, left: FloatArray, right: FloatArray, colour: Colour, opacity: float = 0.4) -> None:
    """Tint what lies between two polylines (N, 2) of equal length. Draws in place."""
    cover = np.zeros(image.shape[:2], np.uint8)
    a, b = _fixed(left), _fixed(right)
    for i in range(len(a) - 1):
        # Piece by piece: the band of a curve that crosses itself is no simple polygon.
        cv2.fillConvexPoly(cover, cv2.convexHull(np.stack([a[i], a[i + 1], b[i + 1], b[i]])), 255, cv2.LINE_AA, _SHIFT)
    weight = cover[..., None].astype(np.float32) * (opacity / 255.0)
    image[:] = np.rint(image * (1.0 - weight) + np.array(colour, np.float32) * weight).astype(np.uint8)


def draw_label(image: Image, text: str, at: tuple[float, float], colour: Colour) -> None:
    """Text on a dark plate whose lower left corner is near ``at``, moved so that it is all in the image."""
    scale = 0.5 * max(1.0, max(image.shape[:2]) / 1280)
    weight = max(1, round(scale * 1.6))
    (width, height), base = cv2.getTextSize(text, cv2.FONT_HERSHEY_SIMPLEX, scale, weight)
    margin = round(6 * scale)
    x = int(np.clip(at[0], margin, max(margin, image.shape[1] - width - margin)))
    y = int(np.clip(at[1], height + margin, max(height + margin, image.shape[0] - base - margin)))
    corner, opposite = (x - margin, y + base), (x + width + margin, y - height - margin)
    cv2.rectangle(image, corner, opposite, (30, 30, 30), cv2.FILLED, cv2.LINE_AA)
    cv2.rectangle(image, corner, (x - margin + max(2, margin // 2), opposite[1]), colour, cv2.FILLED, cv2.LINE_AA)
    cv2.putText(image, text, (x + margin // 2, y), cv2.FONT_HERSHEY_SIMPLEX, scale, WHITE, weight, cv2.LINE_AA)


def _fixed(points: FloatArray) -> npt.NDArray[np.int32]:
    """(N, 2) float px -> fixed point."""
    return np.rint(np.clip(points, -_LIMIT_PX, _LIMIT_PX) * (1 << _SHIFT)).astype(np.int32)
