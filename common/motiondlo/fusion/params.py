"""Parameters of fusion; each with its unit in the name and its bounds."""

from __future__ import annotations

from typing import Literal

from pydantic import BaseModel, ConfigDict, Field


class FusionParams(BaseModel):
    """Scene mode, requests for frames, association of instances to tracks, and what a correction is worth."""

    model_config = ConfigDict(frozen=True, extra="forbid", strict=True)

    method: Literal["bayes", "blend"] = Field(
        default="bayes",
        description="bayes: shapes are observations with covariance, gated and outvoted; blend: the paper's weighting",
    )
    blend_memory_ms: float = Field(
        default=1000.0, ge=1.0, le=60000.0, description="blend: age at which a shape's weight has fallen to 1/e"
    )
    static_after_ms: float = Field(
        default=120.0, ge=1.0, le=5000.0, description="a DLO rests when it has not moved for this long"
    )
    refresh_static_s: float = Field(
        default=2.0, ge=0.1, le=3600.0, description="while static, ask for a new segmentation this often"
    )
    retry_first_ms: float = Field(
        default=200.0, ge=1.0, le=60000.0, description="pause after the first failed segmentation; doubles each time"
    )
    retry_max_ms: float = Field(default=5000.0, ge=1.0, le=600000.0, description="longest pause between retries")
    request_timeout_s: float = Field(
        default=15.0, ge=0.1, le=600.0, description="a segmentation that is not there after this long has failed"
    )
    degraded_after_failures: int = Field(
        default=3, ge=1, le=1000, description="failed segmentations in a row after which the mode says DEGRADED"
    )
    degraded_confidence: float = Field(
        default=0.2, ge=0.0, le=1.0, description="a DLO below this confidence makes the mode DEGRADED"
    )
    history_s: float = Field(
        default=4.0, ge=0.5, le=60.0, description="how far back a segmentation can be compared with the track"
    )
    history_step_ms: float = Field(default=5.0, ge=0.5, le=100.0, description="spacing of that history")
    match_max_px: float = Field(
        default=60.0, gt=0.0, le=2000.0, description="an instance farther than this from a track is not that track"
    )
    reinitialise_min_px: float = Field(
        default=12.0,
        gt=0.0,
        le=1000.0,
        description="a shape farther than this from its track is no correction: one of both is wrong",
    )
    gate_sigma: float = Field(
        default=4.0,
        gt=0.0,
        le=100.0,
        description="a shape farther than this (Mahalanobis distance across the curve) from its track is refused",
    )
    overrule_confidence: float = Field(
        default=0.5,
        ge=0.0,
        le=1.0,
        description="a track below this is overruled by half the votes; one below degraded_confidence at once",
    )
    overrule_votes: int = Field(
        default=4,
        ge=1,
        le=1000,
        description="shapes in a row that agree against a track that no events support meanwhile, to start it anew",
    )
    vote_spacing_ms: float = Field(
        default=500.0, ge=0.0, le=60000.0, description="shapes of frames nearer in time than this are one vote"
    )
    length_tolerance: float = Field(
        default=0.05,
        ge=0.0,
        le=1.0,
        description="a shape whose length differs by more than this share has no tips where the track has none",
    )
    lead_ms: float = Field(
        default=10.0,
        ge=0.0,
        le=1000.0,
        description="a correction takes effect this long (event time) after it was decided, so that transport does not "
        "decide when: a replay gives what the offline run gives",
    )
    homography_sigma_px: float = Field(
        default=1.0, ge=0.0, le=100.0, description="error of the homography, added to a frame shape's uncertainty"
    )
    refine_homography: bool = Field(
        default=False, description="learn a small correction of the homography from DLOs that moved (guarded)"
    )
    tangent_sigma_px: float = Field(
        default=6.0, gt=0.0, le=1000.0, description="uncertainty of a frame shape along the curve where an end is seen"
    )
    birth_score: float = Field(default=0.5, ge=0.0, le=1.0, description="least score for which a new DLO is begun")
    birth_confirmations: int = Field(
        default=2,
        ge=1,
        le=100,
        description="segmentations in which a new DLO must be seen (the first one counts at once)",
    )
    death_confirmations: int = Field(
        default=4, ge=1, le=1000, description="segmentations without it after which a DLO of low confidence is retired"
    )
