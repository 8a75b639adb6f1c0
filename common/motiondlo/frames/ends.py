"""Where a DLO really ends: its skeleton stops half a width short of a tip, and wanders where a gripper begins.

The end is followed outwards along the curve for as long as the image looks like the DLO does elsewhere (prints
included: every row is compared with the nearest of many rows of the same DLO).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.ndimage import gaussian_filter1d

from motiondlo.frames.strip import Scene, sample_strip
from motiondlo.geometry.curve import arc_length, point_at

FloatArray = npt.NDArray[np.float64]

_STEP_PX = 1.0
_CORE_W = 0.34
"""Half width of the middle that is compared, in widths: edges and their shadows stay out."""
_PALETTE_ROWS = 80


@dataclass(frozen=True)
class FollowedEnd:
    """The extension of one end."""

    extension: FloatArray
    """(K, 2) image px, from just beyond the curve's end outwards; (0, 2) when there is none."""
    found: bool
    """Whether the look changed within reach; otherwise the extension is a guess."""
    at_border: bool
    """Whether the image ended first."""
    cut_px: float = 0.0
    """How much of the curve itself lies past the DLO's end."""


@dataclass(frozen=True)
class Palette:
    """The looks of a DLO: rows across its middle, from all along it."""

    rows: FloatArray
    """(P, V*3) image codes."""
    noise: float
    """Usual distance of a row of the DLO to its nearest row elsewhere on it."""
    width: float
    colour: FloatArray
    """(3,) median image code."""


def learn_palette(scene: Scene, centre: FloatArray, width: float) -> Palette:
    """Sample the looks of a DLO between its ends. centre: (K, 2) image px, K >= 2."""
    length = float(arc_length(centre)[-1])
    margin = min(0.8 * width, 0.2 * length)
    count = max(int((length - 2.0 * margin) / _STEP_PX), 4)
    s = np.linspace(margin, length - margin, count)
    rows = _rows(scene, point_at(centre, s), width)
    if len(rows) < 3:
        return Palette(rows, 10.0, width, np.zeros(3))
    step = max(1, len(rows) // _PALETTE_ROWS)
    palette = rows[::step]
    # Rows halfway between palette rows: their distance to the palette is what likeness means.
    between = rows[step // 2 :: step]
    noise = float(np.percentile(_nearest(between, palette, exclude=step < 4), 90.0))
    colour = np.median(rows.reshape(-1, 3), axis=0)
    return Palette(palette, max(noise, 1.5), width, colour)


def follow_end(scene: Scene, centre: FloatArray, side: int, palette: Palette, reach_px: float) -> FollowedEnd:
    """Follow a curve past its first (side 0) or last (side 1) point.

    centre: (K, 2) image px. reach_px: how far at most.
    """
    curve = centre if side == 1 else centre[::-1]
    ahead = continue_curve(curve, palette.width, reach_px)
    width, height = scene.size
    inside = (ahead[:, 0] >= 0) & (ahead[:, 1] >= 0) & (ahead[:, 0] <= width - 1) & (ahead[:, 1] <= height - 1)
    leaves = not inside.all()
    if leaves:
        ahead = ahead[: int(np.argmin(inside))]
    if len(ahead) < 4:
        return FollowedEnd(ahead, leaves, leaves)
    # Some rows of the DLO itself come first: the distance must start low for a change to be seen.
    lead = max(int(0.5 * palette.width), 4)
    length = float(arc_length(curve)[-1])
    body = point_at(curve, np.asarray(length - np.arange(lead, -1, -1) * _STEP_PX, dtype=np.float64))
    places = np.concatenate([body, ahead])
    unlike = _nearest(_rows(scene, places, palette.width), palette.rows)
    unlike = gaussian_filter1d(unlike, 0.7, mode="nearest")
    stop = _first_change(unlike, palette.noise)
    if stop is None:
        return FollowedEnd(ahead if leaves else ahead[: int(0.5 * palette.width)], leaves, leaves)
    kept = stop - lead
    if kept <= 0:
        return FollowedEnd(np.empty((0, 2)), True, False, -float(kept) * _STEP_PX)
    last = int(np.floor(kept))
    part = kept - last
    extension = ahead[:last]
    start = body[-1] if last == 0 else ahead[last - 1]
    if last < len(ahead):
        extension = np.concatenate([extension, (start + part * (ahead[last] - start))[None]])
    return FollowedEnd(extension, True, False)


def continue_curve(curve: FloatArray, width: float, reach_px: float) -> FloatArray:
    """Continue a curve past its last point with its end's tangent and (damped) curvature. (K, 2) -> (reach, 2) px."""
    length = float(arc_length(curve)[-1])
    span = min(3.0 * width, length)
    s = np.linspace(length - span, length, 24)
    points = point_at(curve, s)
    u = (s - length) / span
    coefficients = np.polynomial.polynomial.polyfit(u, points, 2)
    tangent = coefficients[1] / span
    speed = max(float(np.hypot(*tangent)), 1e-9)
    tangent = tangent / speed
    normal = np.array([-tangent[1], tangent[0]])
    bend = float(2.0 * coefficients[2] @ normal) / (span * span * speed * speed)
    bend = float(np.clip(bend, -0.5 / width, 0.5 / width))
    r = np.arange(1, int(reach_px / _STEP_PX) + 1) * _STEP_PX
    angle = bend * r * np.exp(-r / (6.0 * width))
    steps = np.cos(angle)[:, None] * tangent + np.sin(angle)[:, None] * normal
    return np.asarray(curve[-1] + np.cumsum(steps, axis=0) * _STEP_PX, dtype=np.float64)


def _first_change(unlike: FloatArray, noise: float) -> float | None:
    """Sub-sample place at which the look leaves the DLO's for good (three samples), None if it does not."""
    high = float(np.percentile(unlike, 95.0))
    threshold = max(2.5 * noise, 0.3 * high, 6.0)
    beyond = unlike > threshold
    run = beyond[:-2] & beyond[1:-1] & beyond[2:]
    if not run.any():
        return None
    first = int(np.argmax(run))
    plateau = float(np.median(unlike[first + 1 : first + 7]))
    base = float(np.median(unlike[max(0, first - 8) : max(1, first - 2)]))
    half = 0.5 * (base + plateau)
    k = first
    while k > 0 and unlike[k - 1] > half:
        k -= 1
    while k < len(unlike) - 1 and unlike[k] < half:
        k += 1
    if k == 0:
        return 0.0
    rise = unlike[k] - unlike[k - 1]
    return float(k - 1 + np.clip((half - unlike[k - 1]) / max(rise, 1e-9), 0.0, 1.0))


def _rows(scene: Scene, places: FloatArray, width: float) -> FloatArray:
    strip = sample_strip(scene, places, _CORE_W * width, max(_CORE_W * width / 5.0, 0.5))
    smooth = gaussian_filter1d(strip.image, 0.8, axis=1, mode="nearest")
    return np.asarray(smooth.reshape(len(places), -1), dtype=np.float64)


def _nearest(rows: FloatArray, palette: FloatArray, exclude: bool = False) -> FloatArray:
    """Root mean square code difference of each row to its nearest palette row (the second nearest with ``exclude``)."""
    squared = (rows**2).sum(axis=1)[:, None] + (palette**2).sum(axis=1)[None] - 2.0 * rows @ palette.T
    squared = np.maximum(squared, 0.0) / rows.shape[1]
    if exclude and squared.shape[1] > 1:
        return np.asarray(np.sqrt(np.partition(squared, 1, axis=1)[:, 1]), dtype=np.float64)
    return np.asarray(np.sqrt(squared.min(axis=1)), dtype=np.float64)
