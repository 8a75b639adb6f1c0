"""What the segmenter saw in one frame, and how a DLO looks there (also part of corrections)."""

from __future__ import annotations

from typing import Annotated, Final, Literal, Self

from pydantic import Field, model_validator
from pydantic_core import PydanticCustomError

from motiondlo.frames.types import Appearance, EndKind, Instance, Segmentation
from motiondlo.messages.arrays import MAX_DLOS, Array, ArraySpec
from motiondlo.messages.header import Message, ShortText, WireModel

MAX_STRIP: Final = 16384

NODES_SPEC: Final = ArraySpec("<f8", (None, 2))
SIGMA_SPEC: Final = ArraySpec("<f8", (None,))
Nodes = Annotated[Array, NODES_SPEC]
Sigma = Annotated[Array, SIGMA_SPEC]
Positive = Annotated[float, Field(gt=0.0)]
NotNegative = Annotated[float, Field(ge=0.0)]
Share = Annotated[float, Field(ge=0.0, le=1.0)]
End = Literal["tip", "border", "held", "hidden", "unknown"]


def same_length(*arrays: Array | None) -> None:
    """Raises a validation error unless all arrays that are there have one length."""
    lengths = {len(array) for array in arrays if array is not None}
    if len(lengths) > 1:
        raise PydanticCustomError("wrong_shape", "arrays of one DLO differ in length: {n}", {"n": str(sorted(lengths))})


class AppearanceModel(WireModel):
    """See :class:`motiondlo.frames.types.Appearance`."""

    strip: Annotated[Array, ArraySpec("<f4", (None, None), MAX_STRIP)]
    known: Annotated[Array, ArraySpec("|u1", (None, None), MAX_STRIP)]
    s0_px: float
    ds_px: Positive
    dn_px: Positive

    @model_validator(mode="after")
    def _consistent(self) -> Self:
        if self.strip.shape != self.known.shape:
            raise PydanticCustomError("wrong_shape", "strip and known differ in shape")
        return self

    @classmethod
    def from_appearance(cls, look: Appearance | None) -> Self | None:
        """None stays None."""
        if look is None:
            return None
        return cls(strip=look.strip, known=look.known, s0_px=look.s0_px, ds_px=look.ds_px, dn_px=look.dn_px)

    def to_appearance(self) -> Appearance:
        """The dataclass."""
        return Appearance(self.strip, self.known, self.s0_px, self.ds_px, self.dn_px)


class InstanceModel(WireModel):
    """See :class:`motiondlo.frames.types.Instance`."""

    nodes_rgb: Nodes
    nodes_event: Nodes | None
    sigma_px: Sigma
    width_rgb_px: NotNegative
    diameter_px: NotNegative
    score: Share
    ends: tuple[End, End]
    appearance: AppearanceModel | None = None

    @model_validator(mode="after")
    def _consistent(self) -> Self:
        same_length(self.nodes_rgb, self.nodes_event, self.sigma_px)
        return self

    @classmethod
    def from_instance(cls, instance: Instance) -> Self:
        """Raises pydantic.ValidationError for an instance that no reader would accept."""
        return cls(
            nodes_rgb=instance.nodes_rgb,
            nodes_event=instance.nodes_event,
            sigma_px=instance.sigma_px,
            width_rgb_px=float(instance.width_rgb_px),
            diameter_px=float(instance.diameter_px),
            score=float(instance.score),
            ends=(instance.ends[0].value, instance.ends[1].value),
            appearance=AppearanceModel.from_appearance(instance.appearance),
        )

    def to_instance(self) -> Instance:
        """The dataclass."""
        return Instance(
            self.nodes_rgb,
            self.nodes_event,
            self.sigma_px,
            self.width_rgb_px,
            self.diameter_px,
            self.score,
            (EndKind(self.ends[0]), EndKind(self.ends[1])),
            None if self.appearance is None else self.appearance.to_appearance(),
        )


class SegmentationMessage(Message):
    """The instances of one frame, or why there are none; ``t_us`` of the header is the frame's trigger time."""

    frame_name: ShortText
    request_id: Annotated[ShortText, Field(description="Of the command that asked for it; empty: none.")] = ""
    instances: Annotated[tuple[InstanceModel, ...], Field(max_length=MAX_DLOS)] = ()
    failure: Annotated[ShortText, Field(description="Empty: it worked.")] = ""
    backend: ShortText = ""
    elapsed_ms: NotNegative = 0.0

    @classmethod
    def from_segmentation(cls, segmentation: Segmentation, request_id: str = "") -> Self:
        """Raises pydantic.ValidationError for a segmentation that no reader would accept."""
        return cls(
            t_us=segmentation.t_us,
            valid=not segmentation.failure,
            frame_name=segmentation.frame_name,
            request_id=request_id,
            instances=tuple(InstanceModel.from_instance(instance) for instance in segmentation.instances),
            failure=segmentation.failure[:1000],
            backend=segmentation.backend,
            elapsed_ms=float(segmentation.elapsed_ms),
        )

    def to_segmentation(self) -> Segmentation:
        """The dataclass."""
        return Segmentation(
            self.t_us,
            self.frame_name,
            tuple(instance.to_instance() for instance in self.instances),
            self.failure,
            self.backend,
            self.elapsed_ms,
        )
