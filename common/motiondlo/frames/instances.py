"""Segments joined to DLOs, and DLOs turned into instances (paper, "Polyline fitting": merging, fit, warp)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from motiondlo.frames.appearance import sample_appearance
from motiondlo.frames.board_edges import on_board_edge
from motiondlo.frames.covers import Cover, cover_of
from motiondlo.frames.edges import refine_centreline
from motiondlo.frames.end_kinds import EndView, classify_end, may_be_hidden
from motiondlo.frames.merging import SegmentEnd, bezier_bridge, connect
from motiondlo.frames.params import FrameParams, InstanceParams
from motiondlo.frames.polyline_fit import fit_spline
from motiondlo.frames.segments import Segment
from motiondlo.frames.strip import Scene
from motiondlo.frames.types import EndKind, Instance
from motiondlo.geometry.camera_map import CameraMap, map_points
from motiondlo.geometry.curve import arc_length, point_at

FloatArray = npt.NDArray[np.float64]

_TANGENT_W = 1.5
_RAGGED = 0.7
"""Edge support below which short things are rather a gripper's."""
_RULER = 0.25
_SHARP_PX = 3.8
"""Edges up to this width belong to a DLO at rest, whatever its shading."""
_BLUR_SIGMA = 1.5
"""Standard deviation of the centreline per px of further width: the two edges are not smeared alike."""


@dataclass(frozen=True)
class Dlo:
    """A whole DLO, image px."""

    centre: FloatArray
    """(K, 2)."""
    sigma: FloatArray
    """(K,) along the normal."""
    width: float
    ends: tuple[EndKind, EndKind]
    edge_support: float
    width_spread: float
    edge_blur: float
    bow: float
    """Of its measured pieces the largest: how far it leaves a straight line, over its length."""


def end_tangent(centre: FloatArray, side: int, width: float) -> FloatArray:
    """Outward unit tangent at an end, from a parabola over the last widths."""
    curve = centre if side == 1 else centre[::-1]
    length = float(arc_length(curve)[-1])
    span = min(_TANGENT_W * width, length)
    u = np.linspace(-1.0, 0.0, 12)
    fit = np.polynomial.polynomial.polyfit(u, point_at(curve, length + u * span), 2)
    return np.asarray(fit[1] / max(np.hypot(*fit[1]), 1e-9), dtype=np.float64)


def classify_ends(scene: Scene, segments: list[Segment]) -> list[tuple[EndKind, EndKind]]:
    """Kinds of both ends of every segment."""
    kinds = []
    for k, segment in enumerate(segments):
        others = [other.band for i, other in enumerate(segments) if i != k]
        bands = cover_of(scene.board.distance.shape, scene.board.scale, others) if others else None
        pair = []
        for side in (0, 1):
            end = segment.ends[side]
            point = segment.centre[0 if side == 0 else -1]
            outward = end_tangent(segment.centre, side, segment.width)
            view = EndView(point, outward, segment.width, end.found, end.at_border)
            pair.append(classify_end(scene, view, others, bands))
        kinds.append((pair[0], pair[1]))
    return kinds


def join_segments(
    scene: Scene, segments: list[Segment], kinds: list[tuple[EndKind, EndKind]], cover: Cover, params: FrameParams
) -> list[Dlo]:
    """Merge segments of one DLO over gaps; every connection is bridged by a Bezier curve.

    cover: what could hide a DLO.
    """
    ends = []
    for k, segment in enumerate(segments):
        rigid = is_arm(segment, kinds[k], params.instance)
        for side in (0, 1):
            kind = kinds[k][side]
            point = segment.centre[0 if side == 0 else -1]
            outward = end_tangent(segment.centre, side, segment.width)
            view = EndView(point, outward, segment.width, segment.ends[side].found, segment.ends[side].at_border)
            # Only where there is something to be joined: it is not for nothing.
            unsure = len(segments) > 1 and kind in (EndKind.TIP, EndKind.UNKNOWN)
            maybe = unsure and (may_be_hidden(scene, view) or on_board_edge(scene, point, segment.width))
            colour = np.log(segment.palette.colour + 8.0)
            ends.append(SegmentEnd(k, side, point, outward, segment.width, colour, kind, maybe, rigid, segment.source))
    connections = connect(ends, params.merge.max_gap * scene.size[0], params.merge, cover)
    links: dict[tuple[int, int], tuple[SegmentEnd, SegmentEnd]] = {}
    for c in connections:
        links[(c.a.segment, c.a.side)] = (c.a, c.b)
        links[(c.b.segment, c.b.side)] = (c.b, c.a)
    used: set[int] = set()
    dlos = []
    for start in [(k, side) for k in range(len(segments)) for side in (0, 1) if (k, side) not in links]:
        if start[0] not in used:
            dlos.append(_join_from(scene, start, segments, kinds, links, used, params))
    return dlos


def _join_from(
    scene: Scene,
    start: tuple[int, int],
    segments: list[Segment],
    kinds: list[tuple[EndKind, EndKind]],
    links: dict[tuple[int, int], tuple[SegmentEnd, SegmentEnd]],
    used: set[int],
    params: FrameParams,
) -> Dlo:
    parts: list[FloatArray] = []
    sigmas: list[FloatArray] = []
    members: list[Segment] = []
    small_gap = False
    at: tuple[int, int] | None = start
    last_kind = EndKind.UNKNOWN
    while at is not None and at[0] not in used:
        index, side = at
        used.add(index)
        segment = segments[index]
        members.append(segment)
        flip = side == 1
        parts.append(segment.centre[::-1] if flip else segment.centre)
        sigmas.append(segment.sigma[::-1] if flip else segment.sigma)
        last_kind = kinds[index][1 - side]
        link = links.get((index, 1 - side))
        at = None
        if link is not None:
            a, b = link
            bridge = bezier_bridge(a.point, a.outward, b.point, -b.outward, params.merge.bezier_alpha)
            gap = float(np.hypot(*(b.point - a.point)))
            small_gap |= gap <= params.merge.open_gap_w * segment.width
            parts.append(bridge)
            # A hidden stretch may sag by a share of its length in the middle.
            u = np.arange(1, len(bridge) + 1) / (len(bridge) + 1)
            sigmas.append(0.3 + 0.06 * gap * 4.0 * u * (1.0 - u))
            at = (b.segment, b.side)
    lengths = np.array([m.length for m in members])
    width = float((lengths * [m.width for m in members]).sum() / lengths.sum())
    centre, sigma = np.concatenate(parts), np.concatenate(sigmas)
    if small_gap and params.fit.refine:
        refined = refine_centreline(scene, centre, width, 1, params.fit.smooth_length_w)
        centre, sigma = refined.centre, refined.sigma
    blur = max(m.edge_blur for m in members)
    return Dlo(
        centre,
        np.hypot(sigma, _BLUR_SIGMA * max(blur - _SHARP_PX, 0.0)),
        width,
        (kinds[start[0]][start[1]], last_kind),
        float((lengths * [m.edge_support for m in members]).sum() / lengths.sum()),
        float((lengths * [m.width_spread for m in members]).sum() / lengths.sum()),
        blur,
        max(bow_of(m.centre) for m in members),
    )


def score_dlo(dlo: Dlo, params: FrameParams) -> float:
    """0..1: both edges along most of it, one constant width, long for its width."""
    length_w = float(arc_length(dlo.centre)[-1]) / max(dlo.width, 1e-6)
    slender = float(np.clip((length_w - 2.0) / (2.0 * params.instance.min_length_w - 2.0), 0.0, 1.0))
    steady = float(np.clip(1.0 - dlo.width_spread / (params.instance.max_width_spread * dlo.width), 0.0, 1.0))
    return float(np.clip(dlo.edge_support, 0.0, 1.0) * slender * steady)


def is_block(dlo: Dlo, params: InstanceParams) -> bool:
    """Whether it is a part of a gripper rather than a DLO: short for its width, made of pieces as straight as only
    rigid things are or with ragged edges, attached to or hidden by something at one end. What seems to have a tip must
    be as straight as a ruler.
    """
    if not {EndKind.HELD, EndKind.HIDDEN} & set(dlo.ends):
        return False
    if float(arc_length(dlo.centre)[-1]) >= params.block_length_w * dlo.width:
        return False
    if EndKind.TIP in dlo.ends:
        return dlo.bow < _RULER * params.block_straightness
    return dlo.edge_support < _RAGGED or dlo.bow < params.block_straightness


def is_arm(segment: Segment, kinds: tuple[EndKind, EndKind], params: InstanceParams) -> bool:
    """Whether a piece may be a part of a gripper's arm: short, straight, from the border or with ragged edges.

    A cable between its gripper and a plate is short and straight, too, but has its edges and both of its ends.
    """
    if EndKind.TIP in kinds or segment.length >= params.block_length_w * segment.width:
        return False
    if EndKind.BORDER not in kinds and segment.edge_support >= _RAGGED:
        return False
    return segment.edge_support < _RAGGED or bow_of(segment.centre) < params.block_straightness


def bow_of(centre: FloatArray) -> float:
    """How far a curve leaves the straight line through it, over its length."""
    around = centre - centre.mean(axis=0)
    across = np.linalg.svd(around, full_matrices=False)[2][1]
    # Most of it: its followed ends may wander.
    return float(np.percentile(np.abs(around @ across), 85.0)) / max(float(arc_length(centre)[-1]), 1e-9)


def make_instance(
    scene: Scene, dlo: Dlo, event_from_rgb: FloatArray | CameraMap | None, score: float, params: FrameParams
) -> Instance:
    """Fit M nodes, warp them, never masks (paper: point-level warp), and sample the look for the event branch.

    The diameter and sigma are scaled by the ratio of arc lengths, the diameter by the whole curve's (paper), sigma by
    each node's own.
    """
    count = params.fit.nodes
    nodes = fit_spline(dlo.centre, params.fit.knot_spacing_w * dlo.width, count)
    s_all = arc_length(dlo.centre)
    s = np.linspace(0.0, s_all[-1], count)
    sigma = np.interp(s, s_all, dlo.sigma)
    if event_from_rgb is None:
        return Instance(nodes, None, sigma, dlo.width, dlo.width, score, dlo.ends)
    nodes_event = map_points(nodes, event_from_rgb)
    scale = np.gradient(arc_length(nodes_event)) / np.maximum(np.gradient(arc_length(nodes)), 1e-9)
    diameter = dlo.width * float(arc_length(nodes_event)[-1] / max(arc_length(nodes)[-1], 1e-9))
    appearance = sample_appearance(scene.image_bgr, event_from_rgb, nodes_event, diameter)
    return Instance(nodes, nodes_event, sigma * scale, dlo.width, diameter, score, dlo.ends, appearance)
