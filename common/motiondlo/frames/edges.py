"""Sub-pixel centreline from a DLO's two edges, past the paper's pixel skeleton.

Legend: rows ``k`` along the curve, ``g`` edge strength across it, ``c`` offset of the centre from the curve along the
left normal, ``w`` width. A DLO is a band of constant width: the centre is looked for where *both* edges, one width
apart, are strong, so one edge that a cast shadow or a highlight shifts does not pull it.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt
from scipy.linalg import solveh_banded
from scipy.ndimage import gaussian_filter1d

from motiondlo.frames.colour import Float32Array
from motiondlo.frames.edge_kernels import best_path, pair_strength
from motiondlo.frames.strip import Scene, Strip, sample_strip
from motiondlo.geometry.curve import arc_length, left_normals, resample, tangents

FloatArray = npt.NDArray[np.float64]

_ROW_PX, _ROWS_PER_WIDTH = (2.0, 6.0), 17.0
"""Distance of rows along the curve, and how many of them are plenty."""
_COLUMN_PX, _COLUMNS_PER_WIDTH = (0.5, 1.5), 66.0
"""The same for samples across it."""
_LATER_FACTORS = (0.96, 1.0, 1.04, 1.08)
_HOPELESS = 0.1
_BLUR_REACH_PX = 8.0
_STEP_COST = 0.15
_PEAK_PX, _PEAK_W = 2.0, 0.3
"""How far from its place by the common width an edge's peak is looked for: the lesser of both."""


@dataclass(frozen=True)
class WidthSearch:
    """How well a mask knows the DLO's place and width; for the first pass of a refinement."""

    reach_w: float = 0.45
    """How far from the skeleton the centre may be, widths of the mask."""
    factors: tuple[float, ...] = tuple(0.76 + 0.04 * k for k in range(14)) + tuple(1.36 + 0.08 * k for k in range(10))
    """Widths that are tried, widths of the mask: of a DLO of the board's hue it holds the lit flank alone."""
    outer_share: float = 1.0
    """The widest pair of edges is taken whose strength is this share of the strongest pair's: highlights and the
    terminator between a bright and a dark flank have edges too, but the outer ones are the DLO's."""


USUAL = WidthSearch(outer_share=0.9)
FAINT = WidthSearch(0.75, tuple(0.44 + 0.04 * k for k in range(24)), 0.9)
"""The mask holds the shadow as well."""
WIRE = WidthSearch(0.6, tuple(0.5 + 0.1 * k for k in range(20)), 0.85)
"""The mask is two or three pixels wide; a highlight is as strong as the wire."""


@dataclass(frozen=True)
class RefinedCurve:
    """A centreline measured from edges."""

    centre: FloatArray
    """(K, 2) image px, rows ``row_px(width)`` apart."""
    sigma: FloatArray
    """(K,) standard deviation along the normal, px."""
    width: float
    """Distance of the edges, px."""
    width_spread: float
    """Robust standard deviation of the width along the curve, px."""
    edge_support: float
    """Share of rows in which both edges were found one width apart."""
    edge_blur: float
    """Median 10-90 % width of the edges, px: grows with motion."""


def refine_centreline(
    scene: Scene, path: FloatArray, width_px: float, rounds: int, smooth_w: float, search: WidthSearch = USUAL
) -> RefinedCurve:
    """Move a rough centreline to the middle between both edges.

    path: (K, 2) image px, smooth, within about half a width of the truth. width_px: rough width. rounds: passes, each
    on the strip around the last result. smooth_w: smoothing length in widths. search: how far the first pass looks.
    """
    step = row_px(width_px)
    centre = _even(path, step)
    width = width_px
    result: RefinedCurve | None = None
    for turn in range(max(1, rounds)):
        look = search if turn == 0 else WidthSearch(min(search.reach_w, USUAL.reach_w), _LATER_FACTORS)
        strip = sample_strip(scene, centre, (0.7 + look.reach_w) * width + 6.0, column_px(width))
        g = edge_strength(strip)
        width = common_width(g, strip.offsets, width, look)
        rough = centre_path(g, strip.offsets, width, look.reach_w)
        offset, weight, widths = locate_edges(g, strip.offsets, rough, width)
        both = np.isfinite(widths)
        if int(both.sum()) >= 8:
            width = float(np.median(widths[both]))
        smooth, sigma = robust_smooth(offset, weight, smooth_w * width / step)
        blur = _edge_blur(strip, smooth, width) if turn + 1 == max(1, rounds) else 0.0
        centre = centre + smooth[:, None] * left_normals(tangents(centre))
        spread = float(1.4826 * np.median(np.abs(widths[both] - width))) if both.any() else width
        result = RefinedCurve(centre, sigma, width, spread, float(both.mean()), blur)
        if search.outer_share < 1.0 and result.edge_support < _HOPELESS:
            # Of the many strips of a second look few are DLOs.
            break
        if turn + 1 < rounds:
            centre = _even(_thin_out(centre, width, step), step)
    assert result is not None
    return result


def row_px(width: float) -> float:
    """Distance of rows along a DLO of this width, px."""
    return float(np.clip(width / _ROWS_PER_WIDTH, *_ROW_PX))


def column_px(width: float) -> float:
    """Distance of samples across a DLO of this width, px."""
    return float(np.clip(width / _COLUMNS_PER_WIDTH, *_COLUMN_PX))


def edge_strength(strip: Strip) -> FloatArray:
    """Colour gradient across the curve, (K, V), smoothed along it so that noise and prints count less than edges.

    The weaker of two gradients: that of the image, which the board's own texture beside the DLO has too, and that of
    image over board, in which the board's texture shows up where the DLO covers it. An edge of the DLO is in both.
    """
    board = np.median(strip.image[::4, ::4] / np.maximum(strip.ratio[::4, ::4], 1e-3), axis=(0, 1))
    scaled = strip.image * (np.float32(1.0) / np.maximum(board, 1.0).astype(np.float32))
    g = np.minimum(_gradient(strip.ratio), _gradient(scaled)).astype(np.float64)
    g[~strip.known] = 0.0
    return np.asarray(g, dtype=np.float64)


def _gradient(values: Float32Array) -> Float32Array:
    """Norm over the channels of the smoothed derivative across the curve, per column. (K, V, 3) -> (K, V) float32."""
    smooth = cv2.GaussianBlur(values, (0, 0), sigmaX=1.6, sigmaY=1.2, borderType=cv2.BORDER_REPLICATE)
    slope = np.zeros_like(smooth)
    np.subtract(smooth[:, 2:], smooth[:, :-2], out=slope[:, 1:-1])
    np.multiply(slope, slope, out=slope)
    squared = slope[..., 0] + slope[..., 1] + slope[..., 2]
    return np.asarray(np.float32(0.5) * np.sqrt(squared), dtype=np.float32)


def common_width(g: FloatArray, offsets: FloatArray, width: float, search: WidthSearch) -> float:
    """The width at which pairs of edges are strongest, all rows together."""
    # Every third row: neighbours say the same.
    saturated = _saturate(g[::3])
    scores = np.array(
        [_pair_strength(saturated, offsets, width * f, search.reach_w)[0].max(axis=1).sum() for f in search.factors]
    )
    if search.outer_share >= 1.0:
        return float(width * search.factors[int(scores.argmax())])
    good = np.flatnonzero(scores > search.outer_share * scores.max())
    return float(width * search.factors[int(good[-1])]) if len(good) else width


def centre_path(g: FloatArray, offsets: FloatArray, width: float, search_w: float = USUAL.reach_w) -> FloatArray:
    """Offset of the centre per row, (K,): the smooth path through the strongest pairs of edges (dynamic program)."""
    pair, candidates = _pair_strength(_saturate(g), offsets, width, search_w)
    column = np.empty(len(pair), np.int64)
    best_path(np.ascontiguousarray(pair), _STEP_COST, column)
    return np.asarray(candidates[column], dtype=np.float64)


def locate_edges(
    g: FloatArray, offsets: FloatArray, rough: FloatArray, width: float
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Sub-pixel edges near ``rough`` -+ width / 2.

    Returns the centre's offset (K,), its weight (K,) (1 both edges, 0.3 one of them, 0 none) and the width where both
    were found, else NaN (K,).
    """
    reach = min(_PEAK_PX, _PEAK_W * width)
    left, left_strength = _peak_near(g, offsets, rough - 0.5 * width, reach)
    right, right_strength = _peak_near(g, offsets, rough + 0.5 * width, reach)
    typical = np.array([np.median(left_strength), np.median(right_strength)])
    floor = 0.35 * np.maximum(typical, 0.25 * typical.max())
    has_left = np.isfinite(left) & (left_strength > floor[0])
    has_right = np.isfinite(right) & (right_strength > floor[1])
    measured = right - left
    usual = measured[has_left & has_right]
    true_width = float(np.median(usual)) if len(usual) >= 8 else width
    fits = np.abs(measured - true_width) < max(1.3, 0.08 * width)
    both = has_left & has_right & fits
    only_left = has_left & ~has_right
    only_right = has_right & ~has_left
    centre = np.where(both, 0.5 * (left + right), rough)
    centre = np.where(only_left, left + 0.5 * true_width, centre)
    centre = np.where(only_right, right - 0.5 * true_width, centre)
    weight = np.where(both, 1.0, np.where(only_left | only_right, 0.3, 0.0))
    # Both are there but not one width apart: one of them is something else. The middle is a weak hint.
    weight = np.where(has_left & has_right & ~fits, 0.03, weight)
    widths = np.where(both, measured, np.nan)
    return centre, np.where(np.isfinite(centre), weight, 0.0), widths


def robust_smooth(values: FloatArray, weight: FloatArray, length_rows: float) -> tuple[FloatArray, FloatArray]:
    """Smooth a sequence against its bending, with outliers turned down; gaps (weight 0) are bridged.

    values, weight: (K,). Returns the smooth sequence and its standard deviation, both (K,).
    """
    count = len(values)
    stiffness = max(length_rows, 0.5) ** 4
    robust = np.ones(count)
    smooth = np.zeros(count)
    scale = 1.0
    filled = np.where(weight > 0, values, 0.0)
    for _ in range(5):
        w = weight * robust + 1e-6
        smooth = _solve_whittaker(filled, w, stiffness)
        seen = weight >= 0.3
        residual = filled - smooth
        if int(seen.sum()) >= 5:
            scale = max(float(1.4826 * np.median(np.abs(residual[seen]))), 0.08)
        robust = 1.0 / (1.0 + (residual / (2.5 * scale)) ** 2) ** 2
    # Information around each row: what a window of the smoothing length holds.
    information = gaussian_filter1d(weight * robust, max(length_rows, 0.5), mode="nearest")
    effective = np.maximum(information, 1e-4) * max(length_rows, 1.0) * 2.5
    sigma = np.hypot(0.12, scale / np.sqrt(effective))
    return smooth, np.minimum(sigma, 25.0)


def _solve_whittaker(values: FloatArray, weight: FloatArray, stiffness: float) -> FloatArray:
    """Minimise sum w (y - z)^2 + stiffness sum (second difference of z)^2."""
    count = len(values)
    if count < 4:
        mean = float((weight * values).sum() / weight.sum())
        return np.full(count, mean)
    bands = np.zeros((3, count))
    main = np.full(count, 6.0)
    main[[0, -1]] = 1.0
    main[[1, -2]] = 5.0
    if count == 4:
        main[1:3] = 5.0
    first = np.full(count - 1, -4.0)
    first[[0, -1]] = -2.0
    bands[2] = stiffness * main + weight
    bands[1, 1:] = stiffness * first
    bands[0, 2:] = stiffness
    return np.asarray(solveh_banded(bands, weight * values), dtype=np.float64)


def _saturate(g: FloatArray) -> FloatArray:
    """Strength between 0 and 1, so that a few very strong edges (prints, other DLOs) do not outvote the rest."""
    usual = float(np.percentile(g.max(axis=1), 50.0))
    level = max(0.5 * usual, 1e-6)
    return np.asarray(g / (g + level), dtype=np.float64)


def _pair_strength(
    saturated: FloatArray, offsets: FloatArray, width: float, search_w: float
) -> tuple[FloatArray, FloatArray]:
    """(K, C) strength of the pair of edges at ``c`` -+ width / 2 for C candidates; the weaker edge counts double."""
    step = offsets[1] - offsets[0]
    reach = int(search_w * width / step)
    pair = np.empty((len(saturated), 2 * reach + 1))
    pair_strength(np.ascontiguousarray(saturated), 0.5 * width / step, pair)
    return pair, np.arange(-reach, reach + 1) * step


def _peak_near(g: FloatArray, offsets: FloatArray, where: FloatArray, reach_px: float) -> tuple[FloatArray, FloatArray]:
    """Highest point of ``g`` within ``reach_px`` of ``where`` (K,), refined by a parabola; NaN when at the rim."""
    step = offsets[1] - offsets[0]
    reach = int(reach_px / step)
    columns = g.shape[1]
    start = np.round((where - offsets[0]) / step).astype(np.int64)
    index = np.clip(start[:, None] + np.arange(-reach, reach + 1)[None], 1, columns - 2)
    rows = np.arange(len(g))
    near = g[rows[:, None], index]
    best = near.argmax(axis=1)
    at = index[rows, best]
    low, mid, high = g[rows, at - 1], g[rows, at], g[rows, at + 1]
    bend = low - 2.0 * mid + high
    shift = np.where(bend < -1e-12, 0.5 * (low - high) / np.minimum(bend, -1e-12), 0.0)
    place = offsets[at] + np.clip(shift, -0.5, 0.5) * step
    inside = (mid >= low) & (mid >= high)
    return np.where(inside, place, np.nan), mid


def _edge_blur(strip: Strip, centre: FloatArray, width: float) -> float:
    """Median 10-90 % width of the edges, px: of the sharper side, in the channel that changes most.

    The full swing between the middle and well outside over the steepest slope: a smeared edge also looks narrow when
    only its steepest part is looked at.
    """
    step = strip.offsets[1] - strip.offsets[0]
    inner, outer = int(0.1 * width / step), int((0.5 * width + _BLUR_REACH_PX) / step)
    # Every third row: neighbours say the same.
    rows = np.arange(0, len(centre), 3)
    middle = np.round((centre[rows] - strip.offsets[0]) / step).astype(np.int64)
    widths = []
    for sign in (-1, 1):
        columns = middle[:, None] + sign * np.arange(inner, outer + 1)[None]
        index = np.clip(columns, 0, strip.ratio.shape[1] - 1)
        profile = strip.ratio[rows[:, None], index].astype(np.float64)
        swing = profile.max(axis=1) - profile.min(axis=1)
        slope = np.abs(np.diff(profile, axis=1)).max(axis=1) / step
        channel = int(np.argmax(np.median(swing, axis=0)))
        clear = swing[:, channel] > 0.08
        if clear.any():
            widths.append(float(np.median(0.8 * swing[clear, channel] / np.maximum(slope[clear, channel], 1e-6))))
    return min(widths) if widths else 0.0


def _even(path: FloatArray, step_px: float) -> FloatArray:
    length = float(arc_length(path)[-1])
    return resample(path, max(8, round(length / step_px) + 1))


def _thin_out(centre: FloatArray, width: float, step_px: float) -> FloatArray:
    """Smooth the curve itself a little, so that the normals of the next pass do not fan out."""
    sigma = max(0.15 * width / step_px, 0.5)
    smooth = gaussian_filter1d(centre, sigma, axis=0, mode="nearest")
    edge = int(3 * sigma) + 1
    if len(centre) <= 2 * edge:
        return centre
    smooth[:edge], smooth[-edge:] = centre[:edge], centre[-edge:]
    return np.asarray(smooth, dtype=np.float64)
