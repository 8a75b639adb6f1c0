"""Tracked DLOs drawn over an RGB frame or over an event image."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
import numpy.typing as npt

from motiondlo.drawing.palette import BLACK, WHITE, colour_of
from motiondlo.drawing.strokes import draw_dashes, draw_dots, draw_label, draw_line, shade_band, stroke_width
from motiondlo.errors import MotionDLOError
from motiondlo.geometry.curve import left_normals, tangents
from motiondlo.geometry.homography import warp_points

FloatArray = npt.NDArray[np.float64]
Image = npt.NDArray[np.uint8]

_Placement = Callable[[FloatArray], FloatArray]

_BAND_SIGMAS = 2.0
_MAX_BAND_PX = 120.0


@dataclass(frozen=True)
class DrawnDlo:
    """What is drawn of one DLO, in event px."""

    id: int
    nodes: FloatArray
    """(M, 2), M >= 2."""
    sigma_px: FloatArray | None = None
    """(M,) normal standard deviation; its band is two of them to each side. None or NaN: no band."""
    visible: npt.NDArray[np.uint8] | None = None
    """(M,) nodes without support by data are drawn hollow; None: all have it."""
    label: str = ""
    """Empty: the id."""


def overlay(
    image: Image,
    dlos: Sequence[DrawnDlo],
    event_from_rgb: FloatArray | None = None,
    truth: Sequence[FloatArray] = (),
    caption: str = "",
) -> Image:
    """A copy of the image with the DLOs on it: line, nodes, uncertainty band, id at the first node (a ring).

    image: (H, W, 3) uint8 BGR; an RGB frame with ``event_from_rgb`` (3, 3) given, otherwise an event image. truth: true
    centrelines (N, 2) event px, drawn as white dashes. caption: one line at the lower left.
    """
    image = image.copy()
    image_from_event = None if event_from_rgb is None else np.asarray(np.linalg.inv(event_from_rgb), np.float64)

    def place(points: FloatArray) -> FloatArray:
        return points if image_from_event is None else warp_points(points, image_from_event)

    width = stroke_width(image)
    for dlo in dlos:
        _shade_uncertainty(image, dlo, place)
    for curve in truth:
        draw_line(image, place(np.asarray(curve, np.float64)), BLACK, width, outline=False)
        draw_dashes(image, place(np.asarray(curve, np.float64)), WHITE, max(1, width - 1), dash_px=4.0 * width)
    for dlo in dlos:
        nodes = place(np.asarray(dlo.nodes, np.float64))
        colour = colour_of(dlo.id)
        draw_line(image, nodes, colour, width)
        supported = np.ones(len(nodes), bool) if dlo.visible is None else dlo.visible > 0
        # Dots of a dense chain would hide the line.
        spacing_px = max(float(np.hypot(*np.diff(nodes, axis=0).T).mean()), 0.1)
        every = int(np.ceil(min(6.0 * width / spacing_px, len(nodes))))
        nodes, supported = nodes[::every], supported[::every]
        draw_dots(image, nodes[supported], colour, 1.3 * width)
        draw_dots(image, nodes[~supported], (70, 70, 70), 1.3 * width)
        draw_dots(image, nodes[:1], colour, 2.6 * width)
        draw_dots(image, nodes[:1], WHITE, 1.3 * width)
    for dlo in dlos:
        anchor = _inside_point(place(np.asarray(dlo.nodes, np.float64)), image)
        draw_label(
            image, dlo.label or f"id {dlo.id}", (anchor[0] + 6 * width, anchor[1] - 6 * width), colour_of(dlo.id)
        )
    if caption:
        draw_label(image, caption, (8, image.shape[0] - 12), WHITE)
    return image


def _shade_uncertainty(image: Image, dlo: DrawnDlo, place: _Placement) -> None:
    if dlo.sigma_px is None or not np.isfinite(dlo.sigma_px).all():
        return
    nodes = np.asarray(dlo.nodes, np.float64)
    normals = left_normals(tangents(nodes))
    half = np.minimum(_BAND_SIGMAS * np.asarray(dlo.sigma_px, np.float64), _MAX_BAND_PX)[:, None]
    shade_band(image, place(nodes + half * normals), place(nodes - half * normals), colour_of(dlo.id))


def _inside_point(nodes: FloatArray, image: Image) -> FloatArray:
    """The first node in the image, or the first at all."""
    inside = (nodes >= 0).all(axis=1) & (nodes[:, 0] < image.shape[1]) & (nodes[:, 1] < image.shape[0])
    return np.asarray(nodes[int(inside.argmax())])


def png_bytes(image: Image) -> bytes:
    """The image as PNG."""
    ok, data = cv2.imencode(".png", image)
    if not ok:
        raise MotionDLOError("a picture could not be encoded as PNG.", "Report this, with the image's size.")
    return data.tobytes()


def write_png(path: Path, image: Image) -> None:
    """Write a PNG file. Raises MotionDLOError when it cannot be written."""
    try:
        path.write_bytes(png_bytes(image))
    except OSError as error:
        raise MotionDLOError(f"{path}: cannot be written ({error.strerror}).", "Choose another place.") from error
