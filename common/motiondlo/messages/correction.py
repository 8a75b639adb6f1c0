"""A shape from the frame branch for the tracker, at the time of its frame."""

from __future__ import annotations

from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from motiondlo.frames.types import EndKind
from motiondlo.messages.header import Count, Message, TimeUs
from motiondlo.messages.segmentation import AppearanceModel, End, Nodes, NotNegative, Sigma, same_length
from motiondlo.tracking.types import Correction, CorrectionKind


class CorrectionMessage(Message):
    """See :class:`motiondlo.tracking.types.Correction`; ``t_us`` of the header is the frame's trigger time.

    ``correction_seq`` is the correction's own number; the header's ``seq`` counts messages of this topic.
    """

    correction_seq: Count
    id: Count
    kind: Literal["reinitialise", "blend", "retire"]
    nodes: Nodes
    sigma_normal_px: Sigma
    sigma_tangent_px: Sigma
    diameter_px: NotNegative = 0.0
    ends: tuple[End, End] = ("unknown", "unknown")
    appearance: AppearanceModel | None = None
    not_before_us: Annotated[TimeUs, Field(description="Apply at or after this event time; -1: at once.")] = -1

    velocity_px_s: Annotated[Nodes | None, Field(description="At t_us, when a tracker is given back its DLOs.")] = None

    @model_validator(mode="after")
    def _consistent(self) -> Self:
        same_length(self.nodes, self.sigma_normal_px, self.sigma_tangent_px)
        if self.velocity_px_s is not None:
            same_length(self.nodes, self.velocity_px_s)
        return self

    @classmethod
    def from_correction(cls, correction: Correction) -> Self:
        """Raises pydantic.ValidationError for a correction that no reader would accept."""
        return cls(
            t_us=correction.t_us,
            correction_seq=correction.seq,
            id=correction.id,
            kind=correction.kind.value,
            nodes=correction.nodes,
            sigma_normal_px=correction.sigma_normal_px,
            sigma_tangent_px=correction.sigma_tangent_px,
            diameter_px=float(correction.diameter_px),
            ends=(correction.ends[0].value, correction.ends[1].value),
            appearance=AppearanceModel.from_appearance(correction.appearance),
            not_before_us=correction.not_before_us,
            velocity_px_s=correction.velocity_px_s,
        )

    def to_correction(self) -> Correction:
        """The dataclass."""
        return Correction(
            self.correction_seq,
            self.id,
            self.t_us,
            CorrectionKind(self.kind),
            self.nodes,
            self.sigma_normal_px,
            self.sigma_tangent_px,
            self.diameter_px,
            (EndKind(self.ends[0]), EndKind(self.ends[1])),
            None if self.appearance is None else self.appearance.to_appearance(),
            self.not_before_us,
            self.velocity_px_s,
        )
