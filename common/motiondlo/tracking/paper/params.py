"""Parameters of the paper's tracker: one switch per component (for ablations), then the numbers.

Numbers that the paper gives are marked "paper"; the others are choices where it is silent. ``motion_limited_decay`` and
``length_limit`` are repairs of ours without which the method loses fast DLOs and runs up the gripper; the paper as
printed has them off.
"""

from __future__ import annotations

from typing import Self

from pydantic import BaseModel, ConfigDict, Field, model_validator


class PaperParams(BaseModel):
    """Everything that ``PaperTracker`` can be told."""

    model_config = ConfigDict(frozen=True, strict=True, extra="forbid")

    # switches, in the order of the pipeline
    noise_filter: bool = Field(default=True, description="spatio-temporal noise filter; off: every event counts")
    polarity_separated: bool = Field(default=True, description="a time surface per polarity; off: one for both")
    adaptive_decay: bool = Field(default=True, description="decay time from the event rate; off: tau_fixed_us")
    motion_limited_decay: bool = Field(
        default=True, description="ages only up to the time of moving by trail_diameters"
    )
    region_of_interest: bool = Field(default=True, description="only pixels near the predicted curve; off: all pixels")
    diameter_scaled_morphology: bool = Field(default=True, description="kernels from the diameter; off: fixed ones")
    pca_centreline: bool = Field(default=True, description="centreline along the mask's principal axis")
    skeleton_path: bool = Field(default=True, description="centreline from the thinned mask")
    arc_length_parametrisation: bool = Field(default=True, description="off: nodes counted at the mean spacing")
    geodesic_kernel: bool = Field(default=True, description="kernel over arc length; off: over straight distances")
    two_anchor_estep: bool = Field(default=True, description="E-step along the chain; off: straight distances")
    chain_laplacian: bool = Field(default=True, description="penalty on differences of neighbouring weights")
    velocity_warm_start: bool = Field(default=True, description="start from the kernel-smoothed velocity")
    sigma2_management: bool = Field(default=True, description="sigma2 carried on and capped; off: estimated anew")
    two_pass: bool = Field(default=True, description="narrow-kernel pass before the main pass")
    soft_weights: bool = Field(default=True, description="Gaussian observation weights; off: all 1")
    node_visibility: bool = Field(default=True, description="visibility factor of the nodes in the E-step")
    correspondence_prior: bool = Field(default=True, description="visible nodes held near the pre-pass result")
    endpoint_extension: bool = Field(default=True, description="both ends extended to the last observation")
    length_limit: bool = Field(default=True, description="a curve longer than the known length is cut")
    reinit_on_drift: bool = Field(default=True, description="trigger: nodes far from the observations")
    reinit_on_stuck_span: bool = Field(default=True, description="trigger: nodes collapsed onto a cluster")
    reinit_on_stagnation: bool = Field(default=True, description="trigger: sigma2 saturated and nodes at rest")
    hibernation: bool = Field(default=True, description="hold the curve while few pixels are active")
    correction_blend: bool = Field(default=True, description="absorb frame shapes; off: only starts and ends")

    # timing
    period_us: int = Field(default=2000, ge=200, le=100_000, description="update period (paper)")
    longest_step_us: int = Field(default=20_000, ge=1000, le=1_000_000, description="longest gap bridged by velocity")

    # noise filter
    filter_radius_px: int = Field(default=1, ge=1, le=4, description="neighbourhood that must corroborate an event")
    filter_window_us: int = Field(default=20_000, ge=100, le=1_000_000, description="how lately it must have fired")
    hot_pixel_period_us: int = Field(default=200, ge=0, le=100_000, description="faster repeats of a pixel are dropped")

    # recentness
    tau_min_us: int = Field(default=15_000, ge=100, le=1_000_000, description="decay at high event rates (paper)")
    tau_max_us: int = Field(default=60_000, ge=100, le=1_000_000, description="decay at low event rates (paper)")
    tau_fixed_us: int = Field(default=20_000, ge=100, le=1_000_000, description="decay without adaptation")
    rate_low_hz: float = Field(default=50_000.0, gt=0, le=1e9, description="event rate for tau_max_us")
    rate_high_hz: float = Field(default=200_000.0, gt=0, le=1e9, description="event rate for tau_min_us")
    trail_diameters: float = Field(default=0.25, gt=0, le=10, description="longest trail of a moving DLO")
    recentness_min: float = Field(default=0.05, gt=0, lt=1, description="lower clamp of the Otsu threshold (paper)")
    recentness_max: float = Field(default=0.15, gt=0, lt=1, description="upper clamp of the Otsu threshold (paper)")

    # region of interest, mask
    default_diameter_px: float = Field(default=30.0, ge=2, le=200, description="until a frame has measured it")
    roi_half_width_diameters: float = Field(default=2.0, ge=0.5, le=20, description="half width at rest, in diameters")
    roi_speed_gain: float = Field(default=1.0, ge=0, le=20, description="added half width per px moved in an update")
    mask_cell_px: int = Field(default=0, ge=0, le=8, description="edge of a mask cell; 0: about a 12th of the diameter")
    close_diameters: float = Field(default=1.5, ge=0, le=10, description="closing kernel (paper)")
    open_diameters: float = Field(default=0.3, ge=0, le=5, description="opening kernel (paper)")
    close_iteration_px: float = Field(default=25.0, gt=0, le=500, description="one more closing per so much diameter")
    fixed_close_px: float = Field(default=9.0, ge=0, le=200, description="closing kernel without scaling")
    fixed_open_px: float = Field(default=3.0, ge=0, le=50, description="opening kernel without scaling")

    # observations
    observations: int = Field(default=200, ge=20, le=2000, description="N")
    pca_bins: int = Field(default=80, ge=8, le=500, description="equal-count bins along the principal axis")

    # registration
    nodes: int = Field(default=20, ge=5, le=200, description="M (paper)")
    beta_px: float = Field(default=20.0, gt=0, le=10_000, description="kernel bandwidth of the main pass (paper)")
    beta_pre_px: float = Field(default=1.0, gt=0, le=10_000, description="kernel bandwidth of the narrow pre-pass")
    lam: float = Field(default=1e-4, ge=0, le=1e6, description="lambda, weight of the kernel regularisation (paper)")
    mu: float = Field(default=0.1, ge=0, lt=1, description="outlier ratio (paper)")
    mu_motion: float = Field(default=0.5, ge=0, le=1e6, description="weight of the chain Laplacian (paper)")
    k_vis_per_px: float = Field(default=0.05, ge=0, le=10, description="decay of visibility with distance (paper)")
    prior_weight: float = Field(default=0.01, ge=0, le=1e6, description="weight of the correspondence prior")
    prune_px: float = Field(default=80.0, gt=0, le=5000, description="sigma_p of the main pass (paper)")
    prune_pre_px: float = Field(default=300.0, gt=0, le=5000, description="sigma_p of the pre-pass (paper)")
    epsilon_px2: float = Field(default=20.0, ge=0, le=1e5, description="margin of the fit-tied cap (paper)")
    sigma2_min_px2: float = Field(default=4.0, gt=0, le=1e5, description="floor of sigma2")
    sigma2_max_px2: float = Field(default=500.0, gt=0, le=1e6, description="sigma2_max")
    iterations: int = Field(default=8, ge=1, le=200, description="most EM iterations of a pass")
    tolerance_px: float = Field(default=0.01, ge=0, le=10, description="mean node shift that ends a pass")
    alpha_v: float = Field(default=0.85, gt=0, le=1, description="weight of the newest displacement in the velocity")

    # endpoints
    extension_width_diameters: float = Field(default=1.0, gt=0, le=10, description="how near the end's axis")
    extension_clip_px: float = Field(default=30.0, ge=0, le=500, description="longest extension of an update")
    length_tolerance: float = Field(default=0.05, ge=0, le=10, description="longest extension beyond the known length")

    # re-initialisation
    drift_px: float = Field(default=40.0, gt=0, le=1000, description="mean node-to-observation residual")
    stuck_span_px: float = Field(default=50.0, ge=0, le=2000, description="diagonal of the nodes' bounding box")
    stuck_updates: int = Field(default=3, ge=1, le=1000, description="so many updates in a row")
    stagnation_shift_px: float = Field(default=2.0, ge=0, le=100, description="mean node motion of an update")
    stagnation_residual_px: float = Field(default=15.0, ge=0, le=1000, description="and at least this residual")

    # hibernation
    rho_wake: float = Field(default=1e-3, ge=0, le=1, description="active share of the sensor's pixels: moving")
    rho_sleep: float = Field(default=5e-4, ge=0, le=1, description="active share below which it is static")
    rho_updates: int = Field(default=3, ge=1, le=1000, description="so many updates in a row before the state flips")

    # corrections
    blend_decay_us: int = Field(default=2_000_000, ge=1000, le=60_000_000, description="decay of a shape's weight")
    history_us: int = Field(default=3_000_000, ge=10_000, le=60_000_000, description="how far back shapes are taken")

    # start without a frame
    start_length_diameters: float = Field(default=8.0, ge=1, le=1000, description="shortest centreline to start from")
    start_updates: int = Field(default=3, ge=1, le=1000, description="so many such centrelines in a row")

    @model_validator(mode="after")
    def _ordered(self) -> Self:
        for low, high in (
            ("tau_min_us", "tau_max_us"),
            ("rate_low_hz", "rate_high_hz"),
            ("recentness_min", "recentness_max"),
            ("sigma2_min_px2", "sigma2_max_px2"),
            ("rho_sleep", "rho_wake"),
        ):
            if getattr(self, low) > getattr(self, high):
                raise ValueError(f"{low} must not exceed {high}")
        if not (self.pca_centreline or self.skeleton_path):
            raise ValueError("pca_centreline and skeleton_path cannot both be off: nothing would be observed")
        return self
