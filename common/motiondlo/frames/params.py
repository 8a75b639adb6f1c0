"""Parameters of the frame branch; lengths marked ``_w`` are multiples of the DLO's own width."""

from __future__ import annotations

from pydantic import BaseModel, ConfigDict, Field

from motiondlo.frames.backend_params import OnnxParams, Sam3Params


class _Params(BaseModel):
    model_config = ConfigDict(frozen=True, strict=True, extra="forbid")


class CheckParams(_Params):
    """When a frame is refused as a whole."""

    dark_level: int = Field(default=8, ge=0, le=128, description="grey level up to which a pixel counts as black")
    bright_level: int = Field(default=252, ge=128, le=255, description="grey level from which a pixel is saturated")
    max_dark_share: float = Field(default=0.97, gt=0.0, le=1.0, description="more black pixels: the frame is black")
    max_bright_share: float = Field(default=0.7, gt=0.0, le=1.0, description="more saturated ones: over-exposed")
    max_flat_share: float = Field(
        default=0.05, gt=0.0, le=1.0, description="more rows of one single colour at the lower edge: cut short"
    )
    max_blur_px: float = Field(
        default=5.5, gt=0.5, le=100.0, description="10-90 % width of edges of a moving DLO, px at 1296 px width"
    )


class ForegroundParams(_Params):
    """Weight-free segmentation: what differs from the empty board and is no cast shadow."""

    work_width_px: int = Field(default=648, ge=160, le=4096, description="the image is shrunk towards this width")
    threshold: float = Field(
        default=0.22, gt=0.0, le=3.0, description="least difference of log colour that can belong to a DLO"
    )
    noise_factor: float = Field(default=6.0, ge=1.0, le=50.0, description="thresholds in robust standard deviations")
    hysteresis: float = Field(default=1.6, ge=1.0, le=10.0, description="seeds exceed the threshold by this factor")
    shadow_darkest: float = Field(
        default=0.55, gt=0.0, lt=1.0, description="a cast shadow leaves at least this share of the light"
    )
    brightest: float = Field(default=1.13, gt=1.0, le=4.0, description="the board never brightens by more than this")
    local_gain_limit: float = Field(
        default=0.25, ge=0.0, le=1.0, description="log gain that flicker may put on a part of the board"
    )
    plate_window: float = Field(
        default=0.11, gt=0.01, le=0.5, description="window of the median that stands for a missing plate, image widths"
    )
    min_width: float = Field(
        default=0.0095, gt=0.0, le=0.1, description="narrowest DLO, share of the image's width (removes text, lines)"
    )
    max_width: float = Field(default=0.04, gt=0.0, le=0.3, description="widest DLO, share of the image's width")
    wide_factor: float = Field(
        default=1.3, ge=1.0, le=5.0, description="things wider than this times the widest DLO are cut out (grippers)"
    )


class FaintParams(_Params):
    """Second look for DLOs of the board's own colour."""

    enabled: bool = Field(default=True, description="look a second time where the first look found nothing")
    threshold: float = Field(default=0.07, gt=0.0, le=1.0, description="least log difference beyond ``level``")
    noise_factor: float = Field(default=6.0, ge=1.0, le=50.0, description="the same in robust standard deviations")
    level: float = Field(default=0.05, ge=0.0, le=0.5, description="log brightness that the board itself varies by")
    margin: float = Field(default=0.02, ge=0.0, le=0.2, description="distance to what was found already, image widths")
    closing_radius: float = Field(default=0.006, ge=0.0, le=0.05, description="closing over highlights, image widths")
    min_edge_support: float = Field(default=0.7, ge=0.0, le=1.0, description="share of rows with both edges")
    max_width_spread: float = Field(default=0.06, gt=0.0, le=1.0, description="robust spread of the width over width")
    max_edge_blur_px: float = Field(default=3.5, gt=0.5, le=50.0, description="shadows have softer edges, rgb px")
    min_shading: float = Field(default=0.06, ge=0.0, le=1.0, description="difference of the flanks over the board")


class ThinParams(_Params):
    """Another look for wires, narrower than ``foreground.min_width``; needs the empty board's picture."""

    enabled: bool = Field(default=True, description="look for wires where there is a picture of the empty board")
    threshold: float = Field(default=0.1, gt=0.0, le=1.0, description="least log contrast with both sides")
    noise_factor: float = Field(default=6.0, ge=1.0, le=50.0, description="the same in robust standard deviations")
    flank: float = Field(default=0.45, ge=0.0, le=0.95, description="share of a ridge's height where the wire begins")
    margin: float = Field(default=0.006, ge=0.0, le=0.2, description="distance to what was found already, image widths")
    min_piece: float = Field(default=0.03, ge=0.0, le=0.5, description="shorter strips are no wires, image widths")
    min_width: float = Field(default=0.0016, ge=0.0, le=0.1, description="narrowest wire, share of the image's width")
    min_edge_support: float = Field(default=0.6, ge=0.0, le=1.0, description="share of rows with both edges")
    max_width_spread: float = Field(default=0.25, gt=0.0, le=1.0, description="robust spread of the width over width")
    max_beside: float = Field(default=0.014, gt=0.0, le=1.0, description="log difference from the board beside a wire")
    max_strips: int = Field(default=24, ge=1, le=1000, description="the longest so many are measured")
    beside_noise_factor: float = Field(default=4.0, ge=0.0, le=50.0, description="the same in robust deviations")


class CleaningParams(_Params):
    """Mask cleaning before thinning (paper: disks of 6 and 3 px, holes of 300 px at 2592 x 1944)."""

    closing_radius: float = Field(default=0.0023, ge=0.0, le=0.05, description="first closing, image widths")
    final_closing_radius: float = Field(default=0.0012, ge=0.0, le=0.05, description="last closing, image widths")
    adaptive_radius: float = Field(default=0.004, ge=0.0, le=0.05, description="closing before thinning, image widths")
    reduced_radius: float = Field(
        default=0.0012, ge=0.0, le=0.05, description="the same where two components are within its reach, image widths"
    )
    max_hole_area: float = Field(default=6e-5, ge=0.0, le=0.1, description="smaller holes are filled, share of area")
    min_area: float = Field(
        default=6e-4, ge=0.0, le=0.5, description="smaller components go, share of the image's area"
    )


class GraphParams(_Params):
    """Skeleton graph, spurs and crossings."""

    single_masks: bool = Field(
        default=True, description="masks of single DLOs (sam3, onnx, replay) are thinned one by one; off: union (paper)"
    )
    spur_radii: float = Field(default=1.6, ge=0.0, le=10.0, description="shorter free branches are spurs, local radii")
    bridge_length_w: float = Field(default=9.0, ge=0.0, le=50.0, description="longest stretch that two DLOs share")
    bridge_widening: float = Field(
        default=1.12, ge=1.0, le=3.0, description="a shared stretch is wider than its branches by this factor"
    )
    tangent_length_w: float = Field(
        default=1.6, gt=0.1, le=20.0, description="stretch that a branch's tangent is fitted to"
    )
    bend_weight: float = Field(
        default=0.5, ge=0.0, le=10.0, description="pairing: weight of the bend of the connection"
    )
    width_weight: float = Field(default=0.8, ge=0.0, le=10.0, description="pairing: weight of a jump in width (log)")
    colour_weight: float = Field(default=0.5, ge=0.0, le=10.0, description="pairing: weight of a jump in colour (log)")
    max_kink_rad: float = Field(
        default=1.0, gt=0.1, le=3.2, description="chains are taken apart where two chords of a width turn by more"
    )
    min_pair_score: float = Field(default=0.25, ge=-5.0, le=1.0, description="branches that match worse stay unpaired")


class MergeParams(_Params):
    """Joining segments of one DLO over gaps (paper, "Polyline fitting")."""

    max_gap: float = Field(default=0.3, gt=0.0, le=1.0, description="d_max, share of the image's width")
    min_alignment: float = Field(default=0.8, ge=-1.0, le=1.0, description="least -d_i.d_j of the outward tangents")
    min_chord_alignment: float = Field(default=0.8, ge=-1.0, le=1.0, description="least cosine of tangent and gap")
    open_gap_w: float = Field(
        default=2.0, ge=0.0, le=50.0, description="longer gaps need something that could hide the DLO"
    )
    max_width_ratio: float = Field(default=1.3, ge=1.0, le=10.0, description="widths of joined segments")
    max_colour_jump: float = Field(default=0.3, ge=0.0, le=10.0, description="log colour of joined segments")
    alike_width_ratio: float = Field(
        default=1.12, ge=1.0, le=10.0, description="the same where only one end is seen to be hidden"
    )
    alike_colour_jump: float = Field(default=0.18, ge=0.0, le=10.0, description="the same, log colour")
    alike_alignment: float = Field(default=0.9, ge=-1.0, le=1.0, description="the same, both alignments")
    min_cover: float = Field(default=0.75, ge=0.0, le=1.0, description="share of a gap that known things must hide")
    max_bend_w: float = Field(
        default=0.45, ge=0.0, le=3.0, description="alike hidden ends: most bend of their connection, widths over radius"
    )
    bezier_alpha: float = Field(default=0.4, gt=0.0, le=1.0, description="reach of the Bezier control points")


class FitParams(_Params):
    """From an ordered centreline to M equidistant nodes."""

    nodes: int = Field(default=80, ge=8, le=1000, description="M, nodes per DLO")
    savgol_window_w: float = Field(default=1.2, gt=0.0, le=10.0, description="Savitzky-Golay window")
    savgol_order: int = Field(default=3, ge=1, le=5, description="Savitzky-Golay order")
    knot_spacing_w: float = Field(default=1.0, gt=0.1, le=20.0, description="distance of the B-spline's knots")
    refine: bool = Field(default=True, description="sub-pixel centreline from both edges; off: pixel skeleton (paper)")
    refine_rounds: int = Field(default=2, ge=1, le=5, description="passes of the sub-pixel refinement")
    smooth_length_w: float = Field(default=0.9, gt=0.05, le=20.0, description="smoothing length of the refined curve")


class InstanceParams(_Params):
    """What a DLO must look like."""

    min_length: float = Field(default=0.1, gt=0.0, le=1.0, description="shortest DLO, share of the image's width")
    min_length_w: float = Field(default=4.5, gt=0.0, le=100.0, description="shortest DLO, its own widths")
    max_width_spread: float = Field(default=0.25, gt=0.0, le=2.0, description="robust spread of the width over width")
    min_edges: float = Field(default=0.3, ge=0.0, le=1.0, description="share of a measured piece that has both edges")
    min_mask_share: float = Field(
        default=0.6, ge=0.0, le=1.0, description="share of a measured piece that the cleaned mask must cover"
    )
    max_turn_rad: float = Field(default=2.0, gt=0.1, le=6.3, description="sharpest turn within two widths")
    block_length_w: float = Field(
        default=12.0, ge=0.0, le=100.0, description="classical: what is held, shorter and straight is a gripper's part"
    )
    block_straightness: float = Field(default=0.02, ge=0.0, le=0.1, description="its bow over its length")
    min_score: float = Field(default=0.45, ge=0.0, le=1.0, description="instances below are dropped")
    max_instances: int = Field(default=16, ge=1, le=200, description="the best so many are kept")


class FrameParams(_Params):
    """All parameters of the frame branch."""

    backend: str = Field(default="classical", description="segmenter backend: classical, sam3, onnx or replay")
    time_limit_s: float = Field(
        default=10.0, ge=0.1, le=600.0, description="sam3, onnx: a live frame that takes longer is given up"
    )
    load_limit_s: float = Field(
        default=300.0, ge=1.0, le=3600.0, description="sam3, onnx: the same for loading the model"
    )
    replay_folder: str = Field(default="", description="replay: folder of mask images, one folder or file per frame")
    sam3: Sam3Params = Sam3Params()
    onnx: OnnxParams = OnnxParams()
    check: CheckParams = CheckParams()
    foreground: ForegroundParams = ForegroundParams()
    faint: FaintParams = FaintParams()
    thin: ThinParams = ThinParams()
    cleaning: CleaningParams = CleaningParams()
    graph: GraphParams = GraphParams()
    merge: MergeParams = MergeParams()
    fit: FitParams = FitParams()
    instance: InstanceParams = InstanceParams()
