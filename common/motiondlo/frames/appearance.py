"""The look of a DLO and its surroundings in its own coordinates: a straightened strip of log-luminance.

The event branch predicts from it which contrast edges an event camera sees at each place of the DLO (edge profiles,
prints, the tip, and what holds an end).
"""

from __future__ import annotations

import cv2
import numpy as np
import numpy.typing as npt

from motiondlo.frames.types import Appearance, FloatArray
from motiondlo.geometry.camera_map import CameraMap, map_points_back
from motiondlo.geometry.curve import arc_length, left_normals, point_at, tangents

Image = npt.NDArray[np.uint8]

LOG_OFFSET = 0.02
"""Added to the linear luminance before the logarithm: bounds the noise of dark places."""
MIN_HALF_WIDTH_PX = 48.0
"""Wide enough for cast shadows, and for the jaws of a gripper beyond a held end."""

_DS_PX = 2.0
_DN_PX = 1.0
# Rec. 709 luminance of linear B, G, R.
_LUMINANCE_BGR = (0.0722, 0.7152, 0.2126)


def sample_appearance(
    image_bgr: Image,
    event_from_rgb: FloatArray | CameraMap,
    nodes_event: FloatArray,
    diameter_px: float,
    extend_px: float = 80.0,
    half_width_px: float | None = None,
) -> Appearance:
    """Sample the straightened strip around a curve (see :class:`motiondlo.frames.types.Appearance`).

    image_bgr: (H, W, 3) uint8, sRGB encoded. event_from_rgb: (3, 3) float64, or with lenses. nodes_event: (M >= 2, 2)
    float64, event px. diameter_px, extend_px (reach beyond both ends), half_width_px (reach to either side; by default
    48 px or 1.5 diameters, whichever is more): event px. Bilinear sampling at the places that the inverse map gives,
    after a blur where an event pixel covers several image pixels.
    Raises ValueError for fewer than two nodes or values that are not finite, CalibrationError for a singular matrix.
    """
    if nodes_event.ndim != 2 or nodes_event.shape[1] != 2 or len(nodes_event) < 2 or not np.isfinite(nodes_event).all():
        raise ValueError(f"nodes_event: expected (M >= 2, 2) finite values, got shape {nodes_event.shape}")
    half_width = max(MIN_HALF_WIDTH_PX, 1.5 * diameter_px) if half_width_px is None else half_width_px
    half_columns = int(np.ceil(half_width / _DN_PX))
    offsets = np.arange(-half_columns, half_columns + 1) * _DN_PX

    centre, normals, s0_px = _extended_curve(nodes_event, max(diameter_px, 2.0 * _DS_PX), extend_px)
    places = centre[:, None, :] + offsets[None, :, None] * normals[:, None, :]
    places_rgb = map_points_back(places.reshape(-1, 2), event_from_rgb)
    map_x = places_rgb[:, 0].reshape(places.shape[:2])
    map_y = places_rgb[:, 1].reshape(places.shape[:2])
    height, width = image_bgr.shape[:2]
    known = (map_x >= 0.0) & (map_x <= width - 1.0) & (map_y >= 0.0) & (map_y <= height - 1.0)

    # Image pixels per event pixel along the strip's middle: 0.9 for the simulated cells, 1.8 at full resolution.
    steps = np.hypot(np.diff(map_x[:, half_columns]), np.diff(map_y[:, half_columns]))
    scale = float(np.median(steps)) / _DS_PX
    luminance, x0, y0 = _luminance_around(image_bgr, map_x, map_y, scale)
    sampled = cv2.remap(
        luminance,
        np.asarray(map_x - x0, dtype=np.float32),
        np.asarray(map_y - y0, dtype=np.float32),
        cv2.INTER_LINEAR,
        borderMode=cv2.BORDER_REPLICATE,
    )
    strip = np.log(np.clip(sampled, 0.0, 1.0) + np.float32(LOG_OFFSET))
    return Appearance(
        strip=np.ascontiguousarray(strip, dtype=np.float32),
        known=np.ascontiguousarray(known, dtype=np.uint8),
        s0_px=s0_px,
        ds_px=_DS_PX,
        dn_px=_DN_PX,
    )


def _extended_curve(nodes: FloatArray, chord_px: float, extend_px: float) -> tuple[FloatArray, FloatArray, float]:
    """Centre points and left normals every ``_DS_PX`` along the curve and its end tangents; arc length of the first."""
    length = float(arc_length(nodes)[-1])
    rows_before = int(np.ceil(extend_px / _DS_PX))
    rows_inside = int(np.floor(length / _DS_PX)) + 1
    s = np.asarray(np.arange(rows_before + rows_inside + rows_before) - rows_before, np.float64) * _DS_PX
    # End tangents from chords of about one diameter: single segments of a pixel skeleton point anywhere.
    chord = min(chord_px, 0.5 * length)
    ends = point_at(nodes, np.array([0.0, chord, length - chord, length]))
    first, last = ends[1] - ends[0], ends[3] - ends[2]
    first, last = first / max(np.hypot(*first), 1e-9), last / max(np.hypot(*last), 1e-9)
    centre = point_at(nodes, s)
    centre += np.minimum(s, 0.0)[:, None] * first + np.maximum(s - length, 0.0)[:, None] * last
    return centre, left_normals(tangents(centre)), float(s[0])


def _luminance_around(
    image_bgr: Image, map_x: FloatArray, map_y: FloatArray, scale: float
) -> tuple[npt.NDArray[np.float32], int, int]:
    """Linear luminance of the part of the image that the maps reach, and its top left pixel."""
    height, width = image_bgr.shape[:2]
    margin = 4 + int(2 * scale)
    x0 = int(np.clip(np.floor(map_x.min()) - margin, 0, width - 1))
    y0 = int(np.clip(np.floor(map_y.min()) - margin, 0, height - 1))
    x1 = int(np.clip(np.ceil(map_x.max()) + margin, x0 + 1, width))
    y1 = int(np.clip(np.ceil(map_y.max()) + margin, y0 + 1, height))
    part = image_bgr[y0:y1, x0:x1]
    luminance = np.zeros(part.shape[:2], np.float32)
    for channel, weight in enumerate(_LUMINANCE_BGR):
        luminance += cv2.LUT(np.ascontiguousarray(part[:, :, channel]), _linear_from_srgb(weight))
    if scale > 1.2:
        sigma = 0.5 * float(np.sqrt(scale**2 - 1.0))
        luminance = cv2.GaussianBlur(luminance, (0, 0), sigma)
    return luminance, x0, y0


def _linear_from_srgb(weight: float) -> npt.NDArray[np.float32]:
    """(1, 256) float32 table: ``weight`` times the linear value of an sRGB code."""
    code = np.arange(256) / 255.0
    linear = np.where(code <= 0.04045, code / 12.92, ((code + 0.055) / 1.055) ** 2.4)
    return np.asarray(weight * linear, dtype=np.float32)[None]
