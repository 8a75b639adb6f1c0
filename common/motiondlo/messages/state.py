"""The state: where each DLO is. A fixed contract with gateways, monitors and other people's programs."""

from __future__ import annotations

from typing import Annotated, ClassVar, Final, Literal, Self

from pydantic import Field, model_validator

from motiondlo.messages.arrays import MAX_DLOS, Array, ArraySpec
from motiondlo.messages.header import Count, Message, TimeNs, TimeUs, WireModel
from motiondlo.messages.segmentation import NotNegative, Share, same_length

POINTS_SPEC: Final = ArraySpec("<f4", (None, 2))
Points = Annotated[Array, POINTS_SPEC]
Mode = Literal["BOOT", "STATIC", "MOTION", "DEGRADED"]
SourceName = Literal["event", "frame", "predicted"]


class StateDlo(WireModel):
    """One DLO at the state's time."""

    id: Annotated[Count, Field(description="Stable for the life of the DLO, never reused.")]
    nodes: Annotated[Points, Field(description="(M, 2) event px, ordered along the DLO, equidistant.")]
    sigma_px: Annotated[Array, ArraySpec("<f4", (None,)), Field(description="(M,) normal to the curve.")]
    velocity_px_s: Annotated[Points, Field(description="(M, 2).")]
    visible: Annotated[Array, ArraySpec("|u1", (None,)), Field(description="(M,) 1: supported by data lately.")]
    diameter_px: NotNegative
    length_px: NotNegative
    confidence: Share
    moving: bool
    source: SourceName
    t_corrected_us: Annotated[TimeUs, Field(description="Last frame-branch correction absorbed, -1 for none.")]
    nodes_mm: Annotated[Points | None, Field(description="(M, 2) in `work`, when the calibration is known.")] = None

    @model_validator(mode="after")
    def _consistent(self) -> Self:
        same_length(self.nodes, self.sigma_px, self.velocity_px_s, self.visible, self.nodes_mm)
        return self


class StateMessage(Message):
    """All DLOs at ``t_us``.

    The contract fixes this map's keys, so the header's ``source`` and ``valid`` stay off the wire: the owner of the
    topic is the source, and ``mode`` says what the state is worth.
    """

    header_keys: ClassVar[tuple[str, ...]] = ("schema", "seq", "cell", "t_us", "t_sent_ns")

    source: Annotated[str, Field(exclude=True)] = "fusion"
    valid: Annotated[bool, Field(exclude=True)] = True
    t_events_us: Annotated[TimeUs, Field(description="Newest event used.")]
    t_utc_ns: Annotated[int, Field(ge=0, le=(1 << 62) - 1, description="UTC at publication, for people.")]
    t_ingest_ns: Annotated[TimeNs, Field(description="When the newest event used entered the system.")]
    mode: Mode
    dlos: Annotated[tuple[StateDlo, ...], Field(max_length=MAX_DLOS)] = ()
