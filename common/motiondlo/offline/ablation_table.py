"""The ingredients of both trackers that an ablation takes out, one row each: what is changed, and what it was for.

The paper's rows are its components by name, each a switch of :class:`~motiondlo.tracking.paper.params.PaperParams`. The
default tracker is made of one piece: a row takes an ingredient out by the value of a parameter at which it has no
effect, or the least that its bounds allow.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Any


class FrameCut(StrEnum):
    """What of the frame branch is taken out."""

    NOTHING = ""
    APPEARANCE = "appearance"
    """Shapes come without the look of the DLO in the frame."""
    LATE = "late"
    """Only the first frame is ever segmented."""


@dataclass(frozen=True)
class Component:
    """One row."""

    name: str
    description: str
    tracker: Mapping[str, Any] = field(default_factory=dict)
    """Overrides of the tracker's parameters that take it out."""
    frames: FrameCut = FrameCut.NOTHING


def _switch(name: str, description: str, *fields: str) -> Component:
    return Component(name, description, dict.fromkeys(fields, False))


PAPER_COMPONENTS = (
    _switch("noise filter", "events count that a neighbour corroborates", "noise_filter"),
    _switch("polarity-separated surfaces", "a time surface per polarity", "polarity_separated"),
    _switch("adaptive decay", "decay time from the event rate", "adaptive_decay"),
    _switch("motion-limited decay", "our repair: no trail longer than a share of the diameter", "motion_limited_decay"),
    _switch("region of interest", "only pixels near the predicted curve", "region_of_interest"),
    _switch("diameter-scaled morphology", "kernels of mask cleaning from the diameter", "diameter_scaled_morphology"),
    _switch("PCA centreline", "observations along the mask's principal axis", "pca_centreline"),
    _switch("skeleton path", "observations along the thinned mask", "skeleton_path"),
    _switch("arc-length parametrisation", "distances between nodes along the chain", "arc_length_parametrisation"),
    _switch("geodesic kernel", "second-order MCT kernel over arc length", "geodesic_kernel"),
    _switch("two-anchor E-step", "correspondence by distances along the chain", "two_anchor_estep"),
    _switch("chain Laplacian", "neighbours move alike", "chain_laplacian"),
    _switch("velocity warm start", "start from the kernel-smoothed velocity", "velocity_warm_start"),
    _switch("sigma2 management", "variance carried on and capped", "sigma2_management"),
    _switch("two passes", "narrow-kernel pass before the main pass", "two_pass"),
    _switch("soft weights", "observations weighted by their distance", "soft_weights"),
    _switch("visibility prior", "seen nodes count more and stay near the pre-pass", "node_visibility",
            "correspondence_prior"),
    _switch("endpoint extension", "ends drawn out to the last observation", "endpoint_extension"),
    _switch("length limit", "our repair: no curve longer than the DLO", "length_limit"),
    _switch("re-initialisation: drift", "start anew when nodes are far from observations", "reinit_on_drift"),
    _switch("re-initialisation: stuck span", "start anew when nodes have collapsed", "reinit_on_stuck_span"),
    _switch("re-initialisation: stagnation", "start anew when nodes rest and nothing fits", "reinit_on_stagnation"),
    _switch("hibernation", "hold the curve while few pixels are active", "hibernation"),
    _switch("late corrections", "absorb shapes of later frames", "correction_blend"),
)  # fmt: skip

DEFAULT_COMPONENTS = (
    Component("frame's edge profile", "edges as the first frame shows them", frames=FrameCut.APPEARANCE),
    Component("late corrections", "absorb shapes of later frames", frames=FrameCut.LATE),
    Component("profile learning", "edge profiles follow the events", {"learn_rate": 0.0}),
    Component("pull to the frame's profile", "learned profiles return to the frame's", {"learn_pull": 0.0}),
    Component("inner edges", "highlights, prints and shadow as edges beside the silhouettes", {"interior_share": 0.0}),
    Component("gripper patch", "what holds an end is followed as a rigid patch", {"patch_events_min": 5000}),
    Component("gripper at rest", "a silent gripper in view does not move", {"patch_rest_sigma": 5.0}),
    Component("gripper angle", "the patch's rotation is measured", {"patch_angle_sigma_rad": 1.0}),
    Component("patch forgetting", "the patch is learned with a fading memory", {"patch_learn_rate": 0.0}),
    Component(
        "height ratio",
        "what stands higher moves more in the image",
        {"height_ratio": 0.0, "height_ratio_sigma": 0.0},
    ),
    Component("tip profile", "a free tip is measured along the DLO", {"tip_events_min": 2000}),
    Component("patch offset", "where the patch lies outward is estimated", {"patch_offset_sigma_px": 0.0}),
    Component("rest rows", "a visible station without events does not move", {"rest_sigma": 5.0}),
    Component("freezing", "a silent DLO stays as it was", {"idle_share": 0.0}),
    Component("bending prior", "the shape stays near the remembered one", {"bend_sigma": 10.0}),
    Component("bend memory", "the remembered shape follows slowly, not at once", {"bend_memory": 1.0}),
    Component("smooth rates", "neighbouring parts turn alike", {"bend_rate_sigma": 10.0}),
    Component("adaptive noise", "surprise widens the process noise", {"noise_growth_max": 1.0}),
    Component("noise from speed", "little process noise at rest", {"noise_rest_share": 1.0}),
    Component("correlated noise", "accelerations are alike along the DLO", {"correlation_px": 20.0}),
    Component("inextensibility", "the length is fixed", {"stretch_sigma": 0.1, "stretch_walk": 0.01}),
    Component("window from acceleration", "short windows while the velocity changes", {"window_acceleration_px": 20.0}),
    Component("window from travel", "short windows while fast", {"window_travel_px": 50.0}),
    Component("window from event count", "a window ends with enough events", {"events_target": 1000}),
    Component("band from uncertainty", "a less sure curve is searched for more widely", {"band_sigmas": 0.0}),
    Component("age of events", "measurements are for the events' mean time", {"age_share": 0.0}),
    Component("sensor latency", "events are older than their stamps", {"latency_ms": 0.0}),
    Component("robust weights", "outliers count less", {"student_nu": 100.0, "robust_passes": 1}),
    Component("steps within a batch", "a batch is worked off in short steps", {"step_ms": 10.0, "slow_step_ms": 20.0}),
    Component("reach of a held end", "how far a held DLO is seen is learned", {"presence_looks": 10000}),
    Component("reach beyond the image", "a DLO goes on past the border", {"border_reach_px": 0.0}),
    Component("reach under a cover", "a DLO goes on under what hides it", {"hidden_reach_px": 0.0}),
    Component(
        "common errors",
        "what all stations have wrong alike is part of sigma",
        {"bias_px": 0.0, "bias_end_px": 0.0, "bias_tangent_px": 0.0, "slip_px_ms": 0.0},
    ),
)


def components_of(profile: str) -> tuple[Component, ...]:
    """The rows of a profile ("default" or "paper")."""
    return PAPER_COMPONENTS if profile == "paper" else DEFAULT_COMPONENTS
