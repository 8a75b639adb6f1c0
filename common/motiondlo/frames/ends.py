"""Where a DLO really ends: its skeleton stops half a width short of a tip, and wanders where a gripper begins.

The end is followed outwards along the curve for as long as the image looks like the DLO does elsewhere (prints
included: every row is compared with the nearest of many rows of the same DLO).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.ndimage import gaussian_filter1d

from motiondlo.frames.edges import centre_path, column_px, edge_strength, locate_edges, robust_smooth, row_px
from motiondlo.frames.strip import Scene, sample_strip
from motiondlo.geometry.curve import arc_length, left_normals, point_at, tangents

FloatArray = npt.NDArray[np.float64]

_STEP_PX = 1.0
_CORE_W = 0.34
"""Half width of the middle that is compared, in widths: edges and their shadows stay out."""
_PALETTE_ROWS = 48
_PERSIST_PX = 8
"""A change that lasts less is a print."""
_LEAST_CHANGE = 11.0
"""Image codes."""
_EDGES_FROM_W = 3.0
_SURE_SHARE = 0.8
"""Share of a step's rows with both edges from which the way so far does not count as a guess."""
_SHADE = (0.55, 1.06)
"""Range of codes under a cast shadow over codes in the light (codes grow with the 2.2th root of light)."""
_DEEP_SHADE = (0.35, 1.1)
_SHADE_COST = 0.25
_JAW_W = 1.3
"""How far into a gripper a DLO is looked for, widths."""


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
    noise = float(np.percentile(_nearest(between, palette, exclude=step < 4), 75.0))
    colour = np.median(rows.reshape(-1, 3), axis=0)
    return Palette(palette, max(noise, 1.5), width, colour)


def follow_end(scene: Scene, centre: FloatArray, side: int, palette: Palette, reach_px: float) -> FollowedEnd:
    """Follow a curve past its first (side 0) or last (side 1) point.

    centre: (K, 2) image px. reach_px: how far at most without both edges, or over things wider than any DLO. In steps
    of about half a width: the curve is continued, moved to the middle between both edges, and compared with the
    palette, until the look changes for good.
    """
    width = palette.width
    curve = centre if side == 1 else centre[::-1]
    length = float(arc_length(curve)[-1])
    lead = max(int(0.6 * width), 6)
    tail = _tail(curve, length, 3.5 * width)
    # Some rows of the DLO itself come first: the distance must start low for a change to be seen.
    places = point_at(curve, np.asarray(length - np.arange(lead, -1, -1) * _STEP_PX, dtype=np.float64))
    unlike = _unlike(scene, places, side, palette)
    size = np.array(scene.size, dtype=np.float64) - 1.0
    step = max(int(0.55 * width), 6)
    leaves = False
    stop: float | None = None
    supported: list[npt.NDArray[np.bool_]] = []
    unsure_px = 0.0
    while unsure_px < reach_px and len(places) < sum(scene.size) and not leaves:
        ahead = continue_curve(tail, width, step + _PERSIST_PX)
        ahead, edged = _recentre(scene, tail, ahead, width)
        inside = np.asarray(((ahead >= 0.0) & (ahead <= size)).all(axis=1), dtype=np.bool_)
        leaves = not bool(inside[:step].all())
        if not inside.all():
            ahead = ahead[: int(np.argmin(inside))]
        if len(ahead) < 2:
            break
        fresh = _unlike(scene, ahead, side, palette)
        stop = _first_change(np.concatenate([unlike, fresh]), palette.noise)
        if stop is not None:
            places = np.concatenate([places, ahead])
            break
        places = np.concatenate([places, ahead[:step]])
        unlike = np.concatenate([unlike, fresh[:step]])
        supported.append(edged[: len(ahead[:step])])
        sure = float(supported[-1].mean()) > _SURE_SHARE
        if sure and scene.wide is not None:
            # A gripper's parts have edges, too.
            sure = not scene.wide.at(ahead[:step]).any()
        unsure_px = 0.0 if sure else unsure_px + step
        tail = _tail(np.concatenate([tail, ahead[:step]]), None, 3.5 * width)
        # Far out only edges can tell that it is still the DLO, and not a board that looks like it.
        if len(places) - lead - 1 > _EDGES_FROM_W * width and float(supported[-1].mean()) < 0.5:
            break
    grown = places[lead + 1 :]
    if stop is None:
        extension = grown if leaves else grown[: _edged_length(supported, width)]
        further = np.empty((0, 2)) if leaves else _past_jaws(scene, curve, extension, side, palette)
        return FollowedEnd(np.concatenate([extension, further]), leaves or len(further) > 0, leaves)
    kept = stop - lead
    if kept <= 0.0:
        return FollowedEnd(np.empty((0, 2)), True, False, -float(kept) * _STEP_PX)
    last = int(np.floor(kept))
    extension = grown[:last]
    further = _past_jaws(scene, curve, extension, side, palette)
    if not len(further) and last < len(grown):
        start = places[lead + last]
        further = (start + (kept - last) * (grown[last] - start))[None]
    return FollowedEnd(np.concatenate([extension, further]), True, False)


def _past_jaws(scene: Scene, curve: FloatArray, extension: FloatArray, side: int, palette: Palette) -> FloatArray:
    """How a DLO goes on where it seems to have ended: dimmed by a gripper, with one edge under a jaw, to a sharp end.

    Taken only if there is such an end within reach: up to it a part of the width looks like the DLO, however dim, and
    from there on none does. (K, 2) image px, further places; (0, 2) if not.
    """
    none = np.empty((0, 2))
    width = palette.width
    tail = _tail(np.concatenate([curve, extension]), None, 3.5 * width)
    ahead = continue_curve(tail, width, _JAW_W * width + _PERSIST_PX)
    size = np.array(scene.size, dtype=np.float64) - 1.0
    if len(ahead) < _PERSIST_PX or not bool(((ahead >= 0.0) & (ahead <= size)).all()):
        return none
    rows = _rows(scene, ahead, width)
    if side == 0:
        rows = rows.reshape(len(rows), -1, 3)[:, ::-1].reshape(len(rows), -1)
    unlike = gaussian_filter1d(_nearest(rows, palette.rows, lenient=True), 0.7, mode="nearest")
    low, high = max(_LEAST_CHANGE, 4.0 * palette.noise), max(2.0 * _LEAST_CHANGE, 8.0 * palette.noise)
    beyond = unlike > low
    if not beyond.any():
        return none
    k = int(beyond.argmax())
    after = unlike[k + 2 : k + 2 + _PERSIST_PX // 2]
    if k < 2 or len(after) < _PERSIST_PX // 2 or float(after.min()) < high:
        return none
    half = 0.5 * (float(unlike[k - 2]) + float(after.mean()))
    while k < len(unlike) - 1 and unlike[k] < half:
        k += 1
    share = float(np.clip((half - unlike[k - 1]) / max(float(unlike[k] - unlike[k - 1]), 1e-9), 0.0, 1.0))
    return np.concatenate([ahead[:k], (ahead[k - 1] + share * (ahead[k] - ahead[k - 1]))[None]])


def _tail(curve: FloatArray, length: float | None, span: float) -> FloatArray:
    """The last ``span`` px of a curve in steps of one px."""
    total = float(arc_length(curve)[-1]) if length is None else length
    s = np.asarray(total - np.arange(int(min(span, total)), -1, -1) * _STEP_PX, dtype=np.float64)
    return point_at(curve, s)


def _edged_length(supported: list[npt.NDArray[np.bool_]], width: float) -> int:
    """How many steps both edges go along: where a DLO looks like the board, they alone tell its end."""
    rows = np.concatenate(supported) if supported else np.zeros(0, np.bool_)
    window = max(int(0.5 * width), 4)
    if len(rows) < window:
        return len(rows)
    share = np.convolve(rows.astype(np.float64), np.ones(window) / window, mode="valid")
    gone = np.flatnonzero(share < 0.5)
    return int(gone[0]) + window // 2 if len(gone) else len(rows)


def _recentre(
    scene: Scene, tail: FloatArray, ahead: FloatArray, width: float
) -> tuple[FloatArray, npt.NDArray[np.bool_]]:
    """Move a continuation to the middle between both edges; where there are none it stays.

    The tail, already centred, comes first, so that the path of edges starts on the DLO. Returns the places and which of
    them have both edges.
    """
    known = min(int(1.2 * width), len(tail) - 1)
    stride = max(2, round(row_px(width) / _STEP_PX))
    curve = np.concatenate([tail[-known:], ahead])[::stride]
    strip = sample_strip(scene, curve, 1.0 * width + 4.0, column_px(width))
    g = edge_strength(strip)
    rough = centre_path(g, strip.offsets, width)
    offset, weight, widths = locate_edges(g, strip.offsets, rough, width)
    both = np.isfinite(widths)
    # Beyond the end anything may look like edges: only small corrections are followed.
    weight = np.where(np.abs(offset) < 0.35 * width, weight, 0.0)
    held = max(known // (2 * stride), 1)
    weight[:held] = 1.0
    offset[:held] = 0.0
    smooth, _ = robust_smooth(offset, weight, 0.7 * width / (stride * _STEP_PX))
    rows = np.arange(len(curve)) * float(stride)
    moved = np.interp(known + np.arange(len(ahead)), rows, smooth)
    normals = left_normals(tangents(ahead)) if len(ahead) > 1 else np.zeros_like(ahead)
    edged = both[np.clip((known + np.arange(len(ahead))) // stride, 0, len(both) - 1)]
    return np.asarray(ahead + moved[:, None] * normals, dtype=np.float64), edged


def _unlike(scene: Scene, places: FloatArray, side: int, palette: Palette) -> FloatArray:
    rows = _rows(scene, places, palette.width)
    if side == 0:
        # Walked backwards, left and right are swapped.
        rows = rows.reshape(len(rows), -1, 3)[:, ::-1].reshape(len(rows), -1)
    return _nearest(rows, palette.rows)


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
    """Sub-sample place at which the look leaves the DLO's for good, None if it does not."""
    unlike = gaussian_filter1d(unlike, 0.7, mode="nearest")
    beyond = unlike > max(3.0 * noise, _LEAST_CHANGE)
    count = np.convolve(beyond.astype(np.int64), np.ones(_PERSIST_PX, np.int64), mode="valid")
    if not (count == _PERSIST_PX).any():
        return None
    first = int(np.argmax(count == _PERSIST_PX))
    plateau = float(np.median(unlike[first + 2 : first + _PERSIST_PX]))
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


def _nearest(rows: FloatArray, palette: FloatArray, exclude: bool = False, lenient: bool = False) -> FloatArray:
    """Typical code difference of each row to its nearest palette row (the second nearest with ``exclude``).

    lenient: a third of the columns need to be alike, and may be dimmer, at no cost.

    rows: (R, V*3), palette: (P, V*3). Every column of a palette row may be dimmed, as by the shadow of a gripper, which
    also takes the highlight away; dimming costs a little, so that it is no free disguise.
    """
    p, q = rows.reshape(len(rows), -1, 3), palette.reshape(len(palette), -1, 3)
    inner = np.einsum("rvc,pvc->rpv", p, q)
    energy = np.maximum((q**2).sum(axis=2), 1e-9)[None]
    factor = np.clip(inner / energy, *(_DEEP_SHADE if lenient else _SHADE))
    cost = 0.0 if lenient else _SHADE_COST
    squared = (p**2).sum(axis=2)[:, None] - 2.0 * factor * inner
    squared += (factor**2 + (cost * (1.0 - factor)) ** 2) * energy
    # The median over columns: a jaw may cover a part of the DLO before the DLO ends.
    middle = q.shape[1] // (3 if lenient else 2)
    total = np.maximum(np.partition(squared, middle, axis=2)[:, :, middle], 0.0) / 3.0
    if exclude and total.shape[1] > 1:
        return np.asarray(np.sqrt(np.partition(total, 1, axis=1)[:, 1]), dtype=np.float64)
    return np.asarray(np.sqrt(total.min(axis=1)), dtype=np.float64)
