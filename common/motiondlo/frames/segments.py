"""Pieces of DLOs: from a chain of skeleton pixels to a measured centreline with both ends followed."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from itertools import permutations

import numpy as np
import numpy.typing as npt

from motiondlo.frames.covers import Band
from motiondlo.frames.edges import USUAL, RefinedCurve, WidthSearch, refine_centreline
from motiondlo.frames.ends import FollowedEnd, Palette, follow_end, learn_palette
from motiondlo.frames.masks import Mask
from motiondlo.frames.params import FitParams, InstanceParams
from motiondlo.frames.polyline_fit import smooth_path
from motiondlo.frames.strip import Scene
from motiondlo.frames.traversal import Chain
from motiondlo.geometry.curve import arc_length, project, resample

FloatArray = npt.NDArray[np.float64]

_TRIM_W = 2.0
"""How much of both ends is measured anew: a skeleton leaves the centreline half a width before a tip, and turns
towards a jaw two widths before a gripper."""
_MAX_TRIM_SHARE = 0.22
_REPEATED_SHARE = 0.5
_MEASURED_SHARE = 0.9
_LEAST_REST_W = 2.0
_NO_SUPPORT, _SURE_SUPPORT = 0.1, 0.75
_SEARCH_WIDE_W = 2.5
_WIDER = 1.22
_LONG_STRIP, _OTHER_SHARES = 0.1, (0.6, 1.0)
_REACH_W, _REACH = 10.0, 0.08
"""How far an end is followed: the larger of widths and shares of the image's width."""


@dataclass(frozen=True)
class Segment:
    """A measured piece of a DLO, image px."""

    centre: FloatArray
    """(K, 2) from end to end."""
    sigma: FloatArray
    """(K,) along the normal."""
    width: float
    width_spread: float
    edge_support: float
    edge_blur: float
    palette: Palette
    ends: tuple[FollowedEnd, FollowedEnd]
    source: int = -1
    """Number of the single DLO's mask that it was found in; -1 where masks do not tell DLOs apart."""

    @property
    def length(self) -> float:
        """Arc length, px."""
        return float(arc_length(self.centre)[-1])

    @property
    def band(self) -> Band:
        """Centreline and width."""
        return self.centre, self.width


def image_from_working(path: FloatArray, scale: float) -> FloatArray:
    """Working px to image px; pixel centres are integers at both sizes."""
    return np.asarray((path + 0.5) * scale - 0.5, dtype=np.float64)


Screen = Callable[[Scene, RefinedCurve], bool]
"""Whether a refined centreline is worth following to its ends."""


def measure_segment(
    scene: Scene, chain: Chain, params: FitParams, screen: Screen | None = None, search: WidthSearch = USUAL
) -> Segment | None:
    """Trim, smooth and refine a chain, then follow its ends. None when nothing is left, or ``screen`` refuses it."""
    scale = scene.board.scale
    path = image_from_working(trim_ends(chain), scale)
    width = chain.width * scale
    if len(path) < 4 or float(arc_length(path)[-1]) < 1.2 * width:
        return None
    smooth = smooth_path(path, params.savgol_window_w * width, params.savgol_order)
    refined = (
        refine_centreline(scene, smooth, width, params.refine_rounds, params.smooth_length_w, search)
        if params.refine
        else _unrefined(smooth, width)
    )
    # Of the many strips of a second look most are hopeless.
    least = -1.0 if screen is None else _NO_SUPPORT
    if params.refine and search.outer_share < 1.0 and least < refined.edge_support < _SURE_SUPPORT:
        # The outer pair may be a shadow's.
        strongest = refine_centreline(
            scene, smooth, width, params.refine_rounds, params.smooth_length_w, replace(search, outer_share=1.0)
        )
        refined = strongest if strongest.edge_support > refined.edge_support else refined
    if screen is not None and not screen(scene, refined):
        other = _another_width(scene, smooth, width, params, screen, search)
        if other is None:
            return None
        refined = other
    return replace(follow_both_ends(scene, refined), source=chain.source)


def _another_width(
    scene: Scene, smooth: FloatArray, width: float, params: FitParams, screen: Screen, search: WidthSearch
) -> RefinedCurve | None:
    """A long strip between other pairs of edges: a wire's highlight, or its shadow, may have the stronger ones."""
    if not params.refine or float(arc_length(smooth)[-1]) < _LONG_STRIP * scene.size[0]:
        return None
    for share in _OTHER_SHARES:
        look = replace(search, outer_share=share)
        refined = refine_centreline(scene, smooth, width, params.refine_rounds, params.smooth_length_w, look)
        if screen(scene, refined):
            return refined
    return None


def follow_both_ends(scene: Scene, refined: RefinedCurve) -> Segment:
    """Extend (or cut back) a refined centreline to where the DLO ends."""
    palette = learn_palette(scene, refined.centre, refined.width)
    reach_px = max(_REACH_W * refined.width, _REACH * scene.size[0])
    centre, sigma, ends = _extend(scene, refined.centre, refined.sigma, palette, reach_px)
    return Segment(
        centre,
        sigma,
        refined.width,
        refined.width_spread,
        refined.edge_support,
        refined.edge_blur,
        palette,
        ends,
    )


def _extend(
    scene: Scene, centre: FloatArray, sigma: FloatArray, palette: Palette, reach_px: float
) -> tuple[FloatArray, FloatArray, tuple[FollowedEnd, FollowedEnd]]:
    """Add both followed ends to a curve (or cut them off), with growing sigma."""
    width = palette.width
    ends = (follow_end(scene, centre, 0, palette, reach_px), follow_end(scene, centre, 1, palette, reach_px))
    # Past the measured part the curve is a continuation: its error grows with the square of the way.
    grow = [0.5 * width * (np.arange(1, len(end.extension) + 1) / (4.0 * width)) ** 2 for end in ends]
    whole = np.concatenate([ends[0].extension[::-1], centre, ends[1].extension])
    spread = np.concatenate([sigma[0] + grow[0][::-1], sigma, sigma[-1] + grow[1]])
    for side, end in enumerate(ends):
        if end.cut_px > 0.0:
            whole, spread = _cut(whole, spread, side, end.cut_px)
    return whole, spread, ends


def is_plausible(segment: Segment, mask: Mask, scale: float, params: InstanceParams) -> bool:
    """Whether a measured piece can be one of a DLO: steady width, no fold, and where the mask was at first."""
    if segment.width_spread > params.max_width_spread * segment.width or segment.edge_support < params.min_edges:
        return False
    if sharpest_turn(segment.centre, 2.0 * segment.width) > params.max_turn_rad:
        return False
    at = np.round((segment.centre + 0.5) / scale - 0.5).astype(np.int64)
    rows = np.clip(at[:, 1], 0, mask.shape[0] - 1)
    columns = np.clip(at[:, 0], 0, mask.shape[1] - 1)
    return float(mask[rows, columns].mean()) >= params.min_mask_share


def is_measured(path: FloatArray, segments: list[Segment]) -> bool:
    """Whether all of a rough path, (K, 2) image px, lies along a piece that was measured and followed already."""
    rough = path[:: max(1, len(path) // 24)]
    for segment in segments:
        distance, place = project(rough, _coarse(segment))
        along = float(arc_length(rough)[-1])
        if float((distance < 0.4 * segment.width).mean()) > _MEASURED_SHARE and np.ptp(place) > 0.8 * along:
            return True
    return False


def without_repeats(segments: list[Segment]) -> list[Segment]:
    """Drop pieces that lie on a longer one: following an end may run over the next piece of the same DLO."""
    kept: list[Segment] = []
    for segment in sorted(segments, key=lambda item: -item.length):
        repeated = False
        for other in kept:
            near, place = _along(segment, other)
            # Across a crossing only a few points are near, and they are near one place.
            if float(near.mean()) > _REPEATED_SHARE and np.ptp(place[near]) > 0.5 * near.mean() * segment.length:
                repeated = True
                break
        if not repeated:
            kept.append(segment)
    return kept


def without_overlaps(segments: list[Segment]) -> list[Segment]:
    """Cut ends back that run over the end of another piece in line with them, so that the two can be joined there.

    A mask with a gap gives two pieces of one DLO; both ends are followed through the gap, and pass each other.
    """
    result = list(segments)
    for i, j in permutations(range(len(result)), 2):
        near, place = _along(result[i], result[j])
        for side in (0, 1):
            cut = _overlap(near, place, side, result[i], result[j])
            # What would be left of a piece that lies on the other one altogether is no piece.
            if 0.0 < cut < result[i].length - _LEAST_REST_W * result[i].width:
                centre, sigma = _cut(result[i].centre, result[i].sigma, side, cut)
                result[i] = replace(result[i], centre=centre, sigma=sigma)
                break
    return result


def _along(segment: Segment, other: Segment) -> tuple[npt.NDArray[np.bool_], FloatArray]:
    """Which points of a piece, every few px, lie on another one, and at what arc length of it."""
    distance, place = project(_coarse(segment), _coarse(other))
    return np.asarray(distance < 0.38 * min(segment.width, other.width), dtype=np.bool_), place


def _coarse(segment: Segment) -> FloatArray:
    """The centreline in steps of about a third of the width: enough to tell what lies on what."""
    return resample(segment.centre, max(int(3.0 * segment.length / segment.width), 8))


def _overlap(near: npt.NDArray[np.bool_], place: FloatArray, side: int, segment: Segment, other: Segment) -> float:
    """Length, px, of an end of a piece that runs over the end of another in line with it; 0 if it does not."""
    order = near if side == 0 else near[::-1]
    count = int(np.argmin(order)) if not order.all() else 0
    if count < 2:
        return 0.0
    run = place[:count] if side == 0 else place[len(place) - count :]
    own = (count - 1) * segment.length / (len(near) - 1)
    at_end = min(float(run.min()), other.length - float(run.max())) < 0.5 * other.width
    # In line: the run covers as much of the other as of this one.
    return own if at_end and float(np.ptp(run)) > 0.7 * own else 0.0


def sharpest_turn(centre: FloatArray, span_px: float) -> float:
    """Largest change of direction within ``span_px`` along a curve, rad."""
    length = float(arc_length(centre)[-1])
    step = span_px / 6.0
    if length < span_px + 2.0 * step:
        return 0.0
    points = resample(centre, max(int(length / step), 9) + 1)
    d = np.diff(points, axis=0)
    heading = np.unwrap(np.arctan2(d[:, 1], d[:, 0]))
    return float(np.abs(heading[6:] - heading[:-6]).max())


def trim_ends(chain: Chain) -> FloatArray:
    """Take off the unreliable ends of a chain: the last widths, and where it widens into something else.

    The skeleton of a DLO that enters a gripper turns towards a jaw where mask and jaws become one: there the mask is
    wider than the DLO. Returns (K, 2) working px.
    """
    s = arc_length(chain.path)
    width = chain.width
    start, stop = 0.0, float(s[-1])
    radius = np.where(np.isfinite(chain.radius), chain.radius, 0.0)
    wide = 2.0 * radius > _WIDER * width + 0.5
    near_start = wide & (s < _SEARCH_WIDE_W * width)
    near_stop = wide & (s > stop - _SEARCH_WIDE_W * width)
    if near_start.any():
        start = float(s[near_start].max()) + 0.5 * width
    if near_stop.any():
        stop = float(s[near_stop].min()) - 0.5 * width
    trim = min(_TRIM_W * width, _MAX_TRIM_SHARE * float(s[-1]))
    start = max(start, trim)
    stop = min(stop, float(s[-1]) - trim)
    return np.asarray(chain.path[(s >= start) & (s <= stop)], dtype=np.float64)


def _cut(centre: FloatArray, sigma: FloatArray, side: int, cut_px: float) -> tuple[FloatArray, FloatArray]:
    s = arc_length(centre)
    keep = s >= cut_px if side == 0 else s <= s[-1] - cut_px
    return (centre[keep], sigma[keep]) if int(keep.sum()) >= 8 else (centre, sigma)


def _unrefined(path: FloatArray, width: float) -> RefinedCurve:
    count = max(8, round(float(arc_length(path)[-1]) / 2.0) + 1)
    return RefinedCurve(resample(path, count), np.full(count, 0.7), width, 0.0, 1.0, 0.0)
