"""Parameters of the chain tracker: frozen, bounded, one line of meaning each."""

from __future__ import annotations

from pydantic import BaseModel, ConfigDict, Field


class ChainParams(BaseModel):
    """Settings of :class:`motiondlo.tracking.chain.tracker.ChainTracker`; the defaults hold for all kinds of scenes."""

    model_config = ConfigDict(frozen=True, extra="forbid", strict=True)

    output_nodes: int = Field(50, ge=5, le=500, description="equidistant nodes of every reported chain")
    history_ms: int = Field(3500, ge=3000, le=30000, description="own states kept for late corrections")

    # steps
    step_ms: float = Field(1.0, ge=0.2, le=10.0, description="longer batches are worked off in steps of about this")
    most_steps: int = Field(8, ge=1, le=100, description="most steps of one batch; a longer one has longer steps")

    # chain
    knot_px: float = Field(48.0, ge=16.0, le=160.0, description="distance of the filter's control nodes along the arc")
    station_px: float = Field(24.0, ge=8.0, le=80.0, description="distance of the places where events are searched")
    max_nodes: int = Field(48, ge=12, le=96, description="most control nodes; longer chains get wider distances")
    held_cover: float = Field(
        0.4, ge=0.0, le=3.0, description="diameters of the DLO that a gripper covers seen from above"
    )
    held_cover_max_px: float = Field(45.0, ge=0.0, le=200.0, description="most that the chain goes on under a gripper")
    border_extension_px: float = Field(180.0, ge=0.0, le=600.0, description="chain continued beyond the image border")

    # events
    latency_us: float = Field(90.0, ge=0.0, le=1000.0, description="delay from contrast change to event time")
    window_px: float = Field(2.5, ge=1.0, le=12.0, description="motion during which events are gathered")
    window_min_ms: float = Field(1.0, ge=0.3, le=5.0, description="shortest window of events")
    window_max_ms: float = Field(8.0, ge=2.0, le=30.0, description="longest window of events")
    window_accel_px: float = Field(3.0, ge=0.5, le=20.0, description="window <= sqrt(this / normal acceleration)")
    target_events: int = Field(32, ge=10, le=400, description="newest events of a station that are used")
    wake_events: int = Field(10, ge=1, le=1000, description="events about a resting DLO in 4 ms that wake it")
    min_events: int = Field(8, ge=3, le=100, description="fewest events for a station to say anything")
    band_px: float = Field(7.0, ge=3.0, le=20.0, description="least half width of the search about the prediction")
    band_max_px: float = Field(28.0, ge=8.0, le=40.0, description="most half width of the search")

    # observations
    sigma_floor_px: float = Field(0.7, ge=0.1, le=5.0, description="white noise of one profile match")
    min_mean_llr: float = Field(0.25, ge=0.0, le=3.0, description="least mean log-likelihood ratio of a match")
    gate_sigma: float = Field(5.0, ge=2.0, le=20.0, description="innovations beyond this are refused")
    age_gain: float = Field(0.6, ge=0.0, le=1.5, description="share of the events' mean age in the measurement")
    learn_rate: float = Field(0.03, ge=0.0, le=0.2, description="share of the newest profile per update")
    learn_anchor: float = Field(0.3, ge=0.0, le=1.0, description="share of the frame's profile that is never unlearned")

    # motion
    accel_noise: float = Field(0.5, gt=0.0, le=10.0, description="acceleration noise at full motion, px^2/ms^3")
    accel_noise_rest: float = Field(0.02, gt=0.0, le=1.0, description="the same at rest, relative to full motion")
    accel_noise_onset: float = Field(0.1, gt=0.0, le=1.0, description="the same when something is seen to move")
    accel_length_px: float = Field(200.0, ge=30.0, le=2000.0, description="arc length over which accelerations agree")
    velocity_decay_ms: float = Field(80.0, ge=5.0, le=2000.0, description="time constant of velocities without data")
    length_sigma_px: float = Field(0.4, gt=0.0, le=10.0, description="stretch of one node distance, per sqrt(ms)")
    scale_sigma: float = Field(0.003, ge=0.0, le=0.1, description="common change of all lengths in px")
    scale_memory_ms: float = Field(200.0, ge=1.0, le=1e5, description="time constant of that change")
    bend_sigma_px: float = Field(1.5, gt=0.0, le=30.0, description="change of one second difference, per sqrt(ms)")
    bend_memory: float = Field(0.05, ge=0.0, le=1.0, description="share of the current shape in the own shape, per ms")

    # ends
    height_ratio: float = Field(0.06, ge=-0.2, le=0.4, description="expected extra pixel motion of a gripper")
    height_ratio_sigma: float = Field(0.03, ge=0.0, le=0.2, description="its standard deviation")
    patch_offset_sigma_px: float = Field(20.0, ge=0.0, le=100.0, description="parallax of a gripper between cameras")
    quiet_events: int = Field(40, ge=0, le=2000, description="a gripper in view with fewer events is at rest")
    end_sigma_px: float = Field(1.0, ge=0.1, le=10.0, description="white noise of a patch match at an end")

    # texture
    texture_patches: int = Field(10, ge=0, le=64, description="most marks on one DLO that are matched")
    texture_sigma_px: float = Field(1.5, ge=0.1, le=10.0, description="white noise of a mark's place along the DLO")

    # uncertainty
    bias_sigma: float = Field(0.02, ge=0.0, le=0.5, description="correlated profile bias, share of the diameter")
    bias_along_sigma: float = Field(0.07, ge=0.0, le=2.0, description="bias of ends and marks, share of the diameter")
    slide_share: float = Field(0.05, ge=0.0, le=1.0, description="slip along itself, unmeasured, share of the way")
