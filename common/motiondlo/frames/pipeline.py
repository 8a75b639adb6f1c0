"""The frame branch, whole: image in, DLOs out (paper, "Frame Branch: Static DLO")."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from time import perf_counter_ns

import numpy as np
import numpy.typing as npt

from motiondlo.frames.backend import SegmenterBackend, create_backend
from motiondlo.frames.board import BoardModel, model_board
from motiondlo.frames.chain_splitting import split_at_kinks
from motiondlo.frames.checks import FrameFailure, check_frame
from motiondlo.frames.classical import ClassicalBackend, segment_board
from motiondlo.frames.colour import Image
from motiondlo.frames.covers import Cover, cover_of
from motiondlo.frames.edges import FAINT, USUAL, WIRE, WidthSearch
from motiondlo.frames.faint import faint_mask, is_body
from motiondlo.frames.instance_masks import single_masks
from motiondlo.frames.instances import Dlo, classify_ends, is_block, join_segments, make_instance, score_dlo
from motiondlo.frames.mask_cleaning import adaptive_closing, clean_mask, remove_small
from motiondlo.frames.masks import Mask, MaskSet, fit_mask, union
from motiondlo.frames.params import FrameParams
from motiondlo.frames.segments import (
    Screen,
    Segment,
    image_from_working,
    is_measured,
    is_plausible,
    measure_segment,
    without_overlaps,
    without_repeats,
)
from motiondlo.frames.skeleton_graph import build_graph, distance_inside, prune_spurs, skeletonise
from motiondlo.frames.smear import rise_px
from motiondlo.frames.strip import Scene
from motiondlo.frames.thin import beside_limit, is_strip, is_wire, thin_mask
from motiondlo.frames.traversal import Chain, traverse
from motiondlo.frames.types import Segmentation
from motiondlo.geometry.camera_map import CameraMap
from motiondlo.geometry.curve import arc_length

FloatArray = npt.NDArray[np.float64]

_NARROWER = 0.85
"""The narrowest measured width over that of a mask: a mask holds the soft edges too."""


@dataclass
class StageTimes:
    """Host time per stage of one frame."""

    ns: dict[str, int] = field(default_factory=dict)
    _last: int = field(default_factory=perf_counter_ns)

    def lap(self, stage: str) -> None:
        """Count the time since the last call for ``stage``."""
        now = perf_counter_ns()
        self.ns[stage] = self.ns.get(stage, 0) + now - self._last
        self._last = now

    def split(self, stage: str, parts: Mapping[str, int]) -> None:
        """Show the parts of a stage that measured itself; what they do not account for stays with the stage."""
        for name, ns in parts.items():
            self.ns[f"{stage}.{name}"] = self.ns.get(f"{stage}.{name}", 0) + ns
        self.ns[stage] = max(0, self.ns.get(stage, 0) - sum(parts.values()))

    @property
    def total_ms(self) -> float:
        """Sum over all stages."""
        return sum(self.ns.values()) / 1e6


def segment_frame(
    image_bgr: Image,
    background: Image | None,
    event_from_rgb: FloatArray | CameraMap | None,
    params: FrameParams,
    t_us: int,
    frame_name: str,
    backend: SegmenterBackend | None = None,
    times: StageTimes | None = None,
) -> Segmentation:
    """Find every DLO of one frame.

    image_bgr: (H, W, 3) uint8; background: the empty board, same shape, or None; event_from_rgb: (3, 3) or None (then
    nodes stay in RGB px); t_us: trigger time, event clock. backend: one from ``create_backend`` (made anew when None).
    times: filled with host time per stage. A frame that gives nothing is a Segmentation with ``failure`` set to a
    FrameFailure value. Nodes outside the event image are kept; BORDER ends refer to the RGB image.
    Raises ConfigError when ``params`` names an unknown backend.
    """
    times = times if times is not None else StageTimes()
    backend = backend if backend is not None else create_backend(params)

    def failed(reason: FrameFailure) -> Segmentation:
        return Segmentation(t_us, frame_name, failure=reason.value, backend=backend.name, elapsed_ms=times.total_ms)

    refusal = check_frame(image_bgr, background, params.check)
    times.lap("check")
    if refusal is not None:
        return failed(refusal)
    board = model_board(image_bgr, background, params.foreground)
    times.lap("board")
    # The classical backend works on this very comparison.
    masks = (
        segment_board(board, params.foreground)
        if isinstance(backend, ClassicalBackend)
        else backend.segment(image_bgr, background, frame_name)
    )
    times.lap("segment")
    times.split("segment", masks.stages_ns)
    shape = board.distance.shape
    wide = None if masks.obstacles is None else Cover(fit_mask(masks.obstacles, shape), board.scale)
    scene = Scene(image_bgr, background, board, wide)
    mask = refined_mask(masks, board, params)
    single = single_masks(masks, shape, params.cleaning) if params.graph.single_masks else []
    times.lap("clean")
    chains = [
        replace(chain, source=k if single else -1)
        for k, part in enumerate(single or [mask])
        for chain in mask_to_chains(part, masks.obstacles, board, params, times)
    ]
    segments, smeared = measure_chains(scene, chains, mask, params)
    if not isinstance(backend, ClassicalBackend):
        # A model's word that it is a DLO is enough for wires, too.
        narrow = [chain for chain in chains if chain.width < params.foreground.min_width * mask.shape[1]]
        wires = measure_chains(scene, narrow, mask, for_wires(params), None, WIRE)[0]
        segments = without_repeats(segments + wires)
    times.lap("refine")
    if params.faint.enabled and isinstance(backend, ClassicalBackend):
        segments += find_faint(scene, segments, masks.obstacles, params)
        times.lap("faint")
    if params.thin.enabled and board.from_plate and isinstance(backend, ClassicalBackend):
        segments += find_thin(scene, segments, masks.obstacles, params)
        times.lap("wires")
    dlos = assemble_dlos(scene, segments, mask, params)
    if isinstance(backend, ClassicalBackend):
        dlos = [(score, dlo) for score, dlo in dlos if not is_block(dlo, params.instance)]
    times.lap("join")
    sharp = [(score, dlo) for score, dlo in dlos if not is_smeared(dlo.edge_blur, scene, params)]
    instances = tuple(make_instance(scene, dlo, event_from_rgb, score, params) for score, dlo in sharp)
    times.lap("fit")
    if not instances:
        smeared = smeared or bool(dlos) or any(is_smeared(rise_px(scene, chain), scene, params) for chain in chains)
        return failed(FrameFailure.BLURRED if smeared else FrameFailure.NOTHING_FOUND)
    return Segmentation(t_us, frame_name, instances, backend=backend.name, elapsed_ms=times.total_ms)


def refined_mask(masks: MaskSet, board: BoardModel, params: FrameParams) -> Mask:
    """M_t of the paper at working size: union of the candidates, cleaned, closed once more before thinning."""
    mask = union(masks.masks, board.distance.shape)
    return adaptive_closing(clean_mask(mask, params.cleaning), params.cleaning)


def mask_to_chains(
    mask: Mask, obstacles: Mask | None, board: BoardModel, params: FrameParams, times: StageTimes
) -> list[Chain]:
    """Thinning, graph, crossings: ordered skeleton centrelines, working px."""
    if not mask.any():
        return []
    skeleton = skeletonise(mask)
    # Measured together with what is next to it: a DLO that enters a gripper gets wide there.
    radius = distance_inside(mask if obstacles is None else mask | fit_mask(obstacles, mask.shape))
    times.lap("thin")
    graph = prune_spurs(build_graph(skeleton, radius), params.graph.spur_radii)
    chains = traverse(graph, board.image_log, params.graph)
    times.lap("graph")
    return chains


def is_smeared(edge_blur_px: float, scene: Scene, params: FrameParams) -> bool:
    """Whether edges are wider than motion (or focus) may make them; the bound grows with the image's resolution."""
    return edge_blur_px > params.check.max_blur_px * scene.board.scale / 2.0


def measure_chains(
    scene: Scene,
    chains: list[Chain],
    mask: Mask,
    params: FrameParams,
    screen: Screen | None = None,
    search: WidthSearch = USUAL,
) -> tuple[list[Segment], bool]:
    """Measured pieces of DLOs; what cannot be one is left out. The flag: some of that was smeared by motion."""
    least, most = params.foreground.min_width * scene.size[0], params.foreground.max_width * scene.size[0]
    segments: list[Segment] = []
    smeared = False
    pieces = [piece for chain in chains for piece in split_at_kinks(chain, params.graph.max_kink_rad)]
    # The longest first: what it turns out to run over need not be measured.
    for chain in sorted(pieces, key=lambda piece: -piece.length):
        width = chain.width * scene.board.scale
        # The mask's width is rough; the measured one counts.
        if not 0.8 * least <= width <= 1.2 * most or chain.length < 2.5 * chain.width:
            continue
        if is_measured(image_from_working(chain.path, scene.board.scale), segments):
            continue
        segment = measure_segment(scene, chain, params.fit, screen, search)
        if segment is None or not _NARROWER * least <= segment.width <= most:
            continue
        if is_plausible(segment, mask, scene.board.scale, params.instance):
            segments.append(segment)
        else:
            smeared |= is_smeared(segment.edge_blur, scene, params)
    # An end that was followed over the next piece must not make the two look like one seen twice.
    return without_overlaps(without_repeats(without_overlaps(segments))), smeared


def find_faint(scene: Scene, found: list[Segment], obstacles: Mask | None, params: FrameParams) -> list[Segment]:
    """Second look, away from what the first one found, for DLOs of the board's own colour."""
    board = scene.board
    taken = cover_of(board.distance.shape, board.scale, [s.band for s in found], obstacles).mask
    mask = faint_mask(board, taken, params.faint, params.foreground)
    mask = remove_small(mask, params.cleaning.min_area * mask.size)
    chains = mask_to_chains(mask, obstacles, board, params, StageTimes())
    return measure_chains(scene, chains, mask, params, lambda s, curve: is_body(s, curve, params.faint), FAINT)[0]


def find_thin(scene: Scene, found: list[Segment], obstacles: Mask | None, params: FrameParams) -> list[Segment]:
    """Another look, away from what was found, for wires."""
    board = scene.board
    taken = cover_of(board.distance.shape, board.scale, [s.band for s in found], obstacles).mask
    mask = thin_mask(board, taken, params.thin, params.foreground)
    chains = mask_to_chains(mask, obstacles, board, params, StageTimes())
    strips = [chain for chain in chains if is_strip(board, chain)]
    chains = sorted(strips, key=lambda chain: -chain.length)[: params.thin.max_strips]
    limit = beside_limit(board, params.thin)
    return measure_chains(scene, chains, mask, for_wires(params), lambda s, c: is_wire(s, c, params.thin, limit), WIRE)[
        0
    ]


def for_wires(params: FrameParams) -> FrameParams:
    """The same for DLOs below the usual narrowest one."""
    narrow = {"min_width": params.thin.min_width, "max_width": 1.1 * params.foreground.min_width}
    return params.model_copy(update={"foreground": params.foreground.model_copy(update=narrow)})


def assemble_dlos(scene: Scene, segments: list[Segment], mask: Mask, params: FrameParams) -> list[tuple[float, Dlo]]:
    """Join pieces over gaps, and keep what looks like a DLO, best first. mask: what the segmenter found."""
    kinds = classify_ends(scene, segments)
    shape = scene.board.distance.shape
    anything = mask if scene.wide is None else mask | scene.wide.mask
    cover = cover_of(shape, scene.board.scale, [segment.band for segment in segments], anything)
    dlos = join_segments(scene, segments, kinds, cover, params)
    scored = [(score_dlo(dlo, params), dlo) for dlo in dlos if _is_long(dlo, scene.size[0], params)]
    good = sorted((item for item in scored if item[0] >= params.instance.min_score), key=lambda item: -item[0])
    return good[: params.instance.max_instances]


def _is_long(dlo: Dlo, image_width_px: int, params: FrameParams) -> bool:
    length = float(arc_length(dlo.centre)[-1])
    return length >= max(params.instance.min_length * image_width_px, params.instance.min_length_w * dlo.width)
