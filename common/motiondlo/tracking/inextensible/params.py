"""Parameters of the inextensible tracker."""

from __future__ import annotations

from pydantic import ConfigDict, Field

from motiondlo.events.screening_params import ScreeningParams


class InextensibleParams(ScreeningParams):
    """All lengths in event px, times in ms, velocities in px/ms unless a name says otherwise."""

    model_config = ConfigDict(frozen=True, strict=True, extra="forbid")

    # what reaches the buckets: see ScreeningParams

    # curve
    output_nodes: int = Field(50, ge=8, le=400, description="nodes of a published DLO")
    knot_px: float = Field(50.0, ge=15.0, le=200.0, description="distance of the spline's knots along the DLO")
    station_px: float = Field(24.0, ge=6.0, le=40.0, description="distance of the stations that are observed")
    max_coefficients: int = Field(48, ge=8, le=80, description="most spline coefficients of one DLO")
    held_reach_px: float = Field(40.0, ge=0.0, le=100.0, description="how far a held DLO goes on beyond its seen end")
    held_report_px: float = Field(
        6.0, ge=0.0, le=100.0, description="how much of that is published until it is seen how far it goes"
    )
    border_reach_px: float = Field(260.0, ge=0.0, le=2000.0, description="how far a DLO goes on beyond the image")
    hidden_reach_px: float = Field(60.0, ge=0.0, le=500.0, description="how far a DLO goes on under a cover")

    diameter_px: float = Field(24.0, ge=4.0, le=200.0, description="diameter where a correction has none")

    # observation
    profile_reach_px: float = Field(10.0, ge=4.0, le=30.0, description="profile beyond either silhouette")
    edge_width_px: float = Field(0.8, ge=0.3, le=3.0, description="standard deviation of a silhouette in a profile")
    interior_share: float = Field(0.35, ge=0.0, le=0.9, description="share of a profile that is not silhouette")
    contrast_scale: float = Field(0.3, ge=0.02, le=3.0, description="log-luminance step that is surely seen as events")
    contrast_sign: float = Field(0.08, ge=0.01, le=1.0, description="log-luminance step whose sign is trusted")
    gradient_floor: float = Field(0.02, ge=0.0, le=0.5, description="log-luminance per px taken for noise")
    log_floor: float = Field(0.5, ge=0.01, le=5.0, description="events of no known edge, share of a uniform density")
    band_px: float = Field(5.0, ge=2.0, le=30.0, description="search band when the prediction is sure")
    band_sigmas: float = Field(3.0, ge=0.0, le=10.0, description="standard deviations of the prediction that widen it")
    band_max_px: float = Field(30.0, ge=4.0, le=60.0, description="widest search band")
    latency_ms: float = Field(0.09, ge=0.0, le=2.0, description="delay of the sensor")
    window_min_ms: float = Field(1.0, ge=0.25, le=5.0, description="shortest window")
    window_max_ms: float = Field(8.0, ge=1.0, le=15.0, description="longest window")
    window_acceleration_px: float = Field(3.0, ge=0.2, le=20.0, description="window <= sqrt(this / |acceleration|)")
    window_travel_px: float = Field(
        8.0, ge=1.0, le=50.0, description="most normal travel in a window above the minimum"
    )
    events_target: int = Field(40, ge=5, le=1000, description="events of a station that end its window")
    events_min: int = Field(8, ge=3, le=200, description="fewest events of a station that are matched")
    quality_min: float = Field(0.4, ge=0.0, le=3.0, description="least mean log-likelihood ratio an event")
    ambiguous_velocity: float = Field(0.4, ge=0.0, le=3.0, description="below it the direction is not trusted")
    sigma_floor_px: float = Field(0.6, ge=0.05, le=5.0, description="least standard deviation of a station's offset")
    sigma_age: float = Field(0.05, ge=0.0, le=2.0, description="offset error px per (mean age ms)^2")
    age_share: float = Field(1.0, ge=0.0, le=2.0, description="share of the mean age modelled in the measurement")
    student_nu: float = Field(4.0, ge=1.0, le=100.0, description="degrees of freedom of the robust weights")
    robust_passes: int = Field(2, ge=1, le=10, description="reweighted solutions an update")
    learn_rate: float = Field(
        0.06, ge=0.0, le=0.5, description="profile learning; every station takes its turn each fourth update"
    )
    learn_pull: float = Field(0.008, ge=0.0, le=0.5, description="pull of the profile back to the frame's")

    # dynamics
    step_ms: float = Field(1.0, ge=0.25, le=10.0, description="a batch is taken in steps of at most this")
    slow_step_ms: float = Field(2.0, ge=0.25, le=20.0, description="the same while all that moves moves slowly")
    slow_velocity: float = Field(1.0, ge=0.0, le=20.0, description="slow is below this, px/ms, for the noise's memory")
    onset_velocity: float = Field(0.1, ge=0.0, le=20.0, description="below this a motion may just begin: short steps")
    noise_scale: float = Field(0.5, ge=1e-3, le=50.0, description="acceleration noise in motion, px^2/ms^3")
    noise_rest_share: float = Field(0.02, ge=1e-4, le=1.0, description="share of it at rest")
    noise_speed: float = Field(5.0, ge=0.1, le=50.0, description="speed at which the noise is full")
    noise_memory_ms: float = Field(20.0, ge=0.5, le=1000.0, description="how long the noise outlasts the speed")
    noise_surprise: float = Field(1.5, ge=0.5, le=10.0, description="median squared innovation that doubles the noise")
    end_surprise: float = Field(
        4.0, ge=0.5, le=100.0, description="squared innovation of an end that doubles the noise"
    )
    noise_growth_max: float = Field(30.0, ge=1.0, le=1000.0, description="most that surprise multiplies the noise by")
    correlation_px: float = Field(150.0, ge=20.0, le=1000.0, description="correlation length of the acceleration")
    velocity_decay_ms: float = Field(150.0, ge=5.0, le=10000.0, description="time constant of the rates")
    stretch_sigma: float = Field(0.003, ge=0.0, le=0.1, description="standard deviation of the first stretch")
    stretch_walk: float = Field(1e-4, ge=0.0, le=1e-2, description="random walk of the stretch per sqrt(ms)")
    bend_sigma: float = Field(0.01, ge=1e-3, le=10.0, description="bend per knot against the remembered one, sqrt(ms)")
    bend_memory: float = Field(0.05, ge=0.0, le=1.0, description="share of the bend that the memory takes up a ms")
    bend_rate_sigma: float = Field(0.1, ge=1e-3, le=10.0, description="bend of the rates per knot and ms, sqrt(ms)")
    rest_sigma: float = Field(0.3, ge=0.01, le=5.0, description="normal velocity where nothing is seen, sqrt(ms)")
    rest_velocity: float = Field(0.5, ge=0.05, le=5.0, description="silence means rest below this velocity")
    idle_velocity: float = Field(0.3, ge=0.01, le=5.0, description="a silent DLO below this velocity is frozen")
    idle_share: float = Field(0.15, ge=0.0, le=1.0, description="share of stations seen below which a DLO is silent")
    stop_ms: float = Field(4.0, ge=0.5, le=100.0, description="silence after which even a fast DLO is frozen")
    asleep_after_ms: float = Field(25.0, ge=1.0, le=1000.0, description="silence after which a DLO costs nothing")
    wake_events: int = Field(
        10, ge=1, le=1000, description="events near a sleeping DLO, per ms above twice the background, that wake it"
    )

    # ends
    patch_length_px: float = Field(60.0, ge=20.0, le=200.0, description="patch of a gripper, outward")
    patch_inward_px: float = Field(20.0, ge=0.0, le=100.0, description="patch of a gripper, beside the DLO")
    patch_half_width_px: float = Field(48.0, ge=10.0, le=150.0, description="patch of a gripper, to either side")
    patch_events_min: int = Field(60, ge=10, le=5000, description="fewest events of a patch that are matched")
    patch_events_used: int = Field(300, ge=50, le=5000, description="events of a patch that are matched at most")
    patch_reach_px: int = Field(6, ge=2, le=20, description="search for a patch to either side")
    patch_sigma_px: float = Field(1.0, ge=0.1, le=10.0, description="standard deviation of a patch's place")
    patch_angle_sigma_rad: float = Field(0.04, ge=0.001, le=1.0, description="standard deviation of a patch's angle")
    patch_offset_sigma_px: float = Field(
        2.0, ge=0.0, le=20.0, description="standard deviation of where a patch was when it was first seen, outward"
    )
    patch_learn_rate: float = Field(0.06, ge=0.0, le=0.5, description="learning of a patch every other update")
    height_ratio: float = Field(
        0.055, ge=0.0, le=0.5, description="what stands higher moves this much more in the image"
    )
    height_ratio_sigma: float = Field(0.02, ge=0.0, le=0.2, description="its standard deviation")
    patch_rest_sigma: float = Field(0.15, ge=0.01, le=5.0, description="velocity of a silent gripper, px/ms sqrt(ms)")
    tip_sigma_px: float = Field(0.6, ge=0.1, le=20.0, description="standard deviation of a tip's place")
    tip_offset_sigma_px: float = Field(2.0, ge=0.1, le=40.0, description="standard deviation of the first frame's tip")
    end_absent_ms: float = Field(4.0, ge=0.5, le=100.0, description="absence after which an open end is a tip")
    end_found_sigma_px: float = Field(8.0, ge=0.5, le=40.0, description="standard deviation of a tip just found")
    tip_events_min: int = Field(40, ge=5, le=2000, description="fewest events of a tip that are matched")
    tip_events_target: int = Field(120, ge=10, le=5000, description="events of a tip that end its window")

    presence_velocity: float = Field(
        0.15, ge=0.05, le=10.0, description="motion across from which silhouettes are judged"
    )
    presence_reach_px: float = Field(3.0, ge=0.5, le=10.0, description="reach of a silhouette")
    presence_looks: int = Field(15, ge=1, le=10000, description="looks before it is believed how far a held DLO goes")
    presence_margin_px: float = Field(
        2.0, ge=0.0, le=20.0, description="how far it goes on beyond its last silhouettes"
    )
    presence_window_ms: float = Field(20.0, ge=1.0, le=100.0, description="longest window in which they are judged")
    presence_rate: float = Field(0.03, ge=0.0, le=1.0, description="learning of how far a held DLO is seen")
    presence_share: float = Field(0.4, ge=0.05, le=1.0, description="share of a silhouette's events that is presence")

    # late corrections
    correction_fade_ms: float = Field(10.0, ge=0.1, le=10000.0, description="measured this long, an old error is gone")
    correction_bias_px: float = Field(1.0, ge=0.0, le=20.0, description="error that all nodes of a correction share")

    # honesty
    variance_share: float = Field(0.8, ge=0.1, le=10.0, description="share of the filter's variance that is published")
    bias_px: float = Field(0.3, ge=0.0, le=5.0, description="standard deviation of what stations have in common")
    bias_end_px: float = Field(1.5, ge=0.0, le=20.0, description="what the ends may be off across beyond that")
    bias_end_reach_px: float = Field(25.0, ge=1.0, le=500.0, description="how far from an end that fades by 1/e")
    bias_tangent_px: float = Field(2.0, ge=0.0, le=20.0, description="the same along the DLO")
    slip_px_ms: float = Field(0.15, ge=0.0, le=5.0, description="growth of that while it moves and no end is seen")
    slip_share: float = Field(0.03, ge=0.0, le=1.0, description="growth of it on the way, while no free tip is seen")
    visible_support: float = Field(0.35, ge=0.0, le=1.0, description="support above which a node counts as visible")


def screening_of(params: InextensibleParams) -> ScreeningParams:
    """The screening's part of ``params``."""
    return ScreeningParams(**{name: getattr(params, name) for name in ScreeningParams.model_fields})
