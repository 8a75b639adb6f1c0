"""All DLOs after each event batch, as the tracker publishes them."""

from __future__ import annotations

from typing import Annotated, Any, Final, Literal, Self

from pydantic import Field, model_validator

from motiondlo.messages.arrays import MAX_DLOS, Array, ArraySpec
from motiondlo.messages.header import Count, Message, ShortText, Stamp, TimeNs, TimeUs, WireModel, trusted
from motiondlo.messages.segmentation import Nodes, NotNegative, Share, same_length
from motiondlo.tracking.types import TrackSource, TrackState, TrackUpdate

MAX_COUNTERS: Final = 64
MAX_KEY_LENGTH: Final = 64
_SOURCES: Final = {source.value: source for source in TrackSource}

Counters = Annotated[
    dict[Annotated[str, Field(max_length=MAX_KEY_LENGTH)], Annotated[int, Field(ge=0, le=(1 << 62) - 1)]],
    Field(max_length=MAX_COUNTERS),
]


class TrackModel(WireModel):
    """See :class:`motiondlo.tracking.types.TrackState`."""

    id: Count
    nodes: Nodes
    velocity_px_s: Nodes
    cov_px2: Annotated[Array, ArraySpec("<f8", (None, 3))]
    visible: Annotated[Array, ArraySpec("|u1", (None,))]
    diameter_px: NotNegative
    confidence: Share
    moving: bool
    source: Literal["event", "frame", "predicted"]
    t_corrected_us: TimeUs
    fit_px: NotNegative = 0.0
    reinitialised: Count = 0

    @model_validator(mode="after")
    def _consistent(self) -> Self:
        same_length(self.nodes, self.velocity_px_s, self.cov_px2, self.visible)
        return self


class TrackMessage(Message):
    """See :class:`motiondlo.tracking.types.TrackUpdate`.

    50 nodes: written in 17 us, read and checked in 23 us. Considered and rejected: checks written out by hand, field by
    field; they took 33 us, since pydantic's run outside of the interpreter.
    """

    t_events_us: TimeUs
    t_ingest_ns: TimeNs = 0
    active_ratio: NotNegative = 0.0
    events: Count = 0
    stages_ns: Counters = Field(default_factory=dict)
    rejects: Counters = Field(default_factory=dict)
    disturbed: ShortText = ""
    dlos: Annotated[tuple[TrackModel, ...], Field(max_length=MAX_DLOS)]

    @classmethod
    def from_update(cls, update: TrackUpdate, t_ingest_ns: int, valid: bool = True) -> Self:
        """The message of an update whose newest event entered the system at ``t_ingest_ns``; arrays are not copied."""
        return trusted(
            cls,
            {
                "t_us": update.t_us,
                "valid": valid,
                "t_events_us": update.t_events_us,
                "t_ingest_ns": t_ingest_ns,
                "active_ratio": update.active_ratio,
                "events": update.events,
                "stages_ns": update.stages_ns,
                "rejects": update.rejects,
                "disturbed": update.disturbed,
                "dlos": tuple(trusted(TrackModel, vars(track)) for track in update.tracks),
            },
        )

    def to_update(self) -> TrackUpdate:
        """The dataclass; its arrays are read-only."""
        return TrackUpdate(
            self.t_us,
            self.t_events_us,
            tuple(_track_state(dlo) for dlo in self.dlos),
            self.active_ratio,
            self.events,
            self.stages_ns,
            self.rejects,
            self.disturbed,
        )

    def wire_map(self, stamp: Stamp) -> dict[str, Any]:
        """The msgpack map, written out for speed."""
        return {
            "schema": self.schema_major,
            "seq": stamp.seq,
            "cell": stamp.cell,
            "source": stamp.source,
            "t_us": self.t_us,
            "t_sent_ns": stamp.t_sent_ns,
            "valid": self.valid,
            "t_events_us": self.t_events_us,
            "t_ingest_ns": self.t_ingest_ns,
            "active_ratio": float(self.active_ratio),
            "events": self.events,
            "stages_ns": self.stages_ns,
            "rejects": self.rejects,
            "disturbed": self.disturbed,
            "dlos": [_track_map(dlo) for dlo in self.dlos],
        }


def _track_state(dlo: TrackModel) -> TrackState:
    return TrackState(
        dlo.id,
        dlo.nodes,
        dlo.velocity_px_s,
        dlo.cov_px2,
        dlo.visible,
        dlo.diameter_px,
        dlo.confidence,
        dlo.moving,
        _SOURCES[dlo.source],
        dlo.t_corrected_us,
        dlo.fit_px,
        dlo.reinitialised,
    )


def _track_map(dlo: TrackModel) -> dict[str, Any]:
    return {
        "id": dlo.id,
        "nodes": _pack(dlo.nodes, "<f8"),
        "velocity_px_s": _pack(dlo.velocity_px_s, "<f8"),
        "cov_px2": _pack(dlo.cov_px2, "<f8"),
        "visible": _pack(dlo.visible, "|u1"),
        "diameter_px": float(dlo.diameter_px),
        "confidence": float(dlo.confidence),
        "moving": bool(dlo.moving),
        "source": str(dlo.source),
        "t_corrected_us": int(dlo.t_corrected_us),
        "fit_px": float(dlo.fit_px),
        "reinitialised": int(dlo.reinitialised),
    }


def _pack(array: Array, dtype: str) -> dict[str, object]:
    # astype only where a tracker hands over another type than it promised: the wire's is fixed.
    data = array if array.dtype == dtype else array.astype(dtype)
    return {"dtype": dtype, "shape": data.shape, "data": data.tobytes()}
