"""Why an input was not used. Every reject is counted under one of these reasons and shows up in health."""

from __future__ import annotations

from collections import Counter
from enum import StrEnum


class RejectReason(StrEnum):
    """Reasons for which a datum is refused at a boundary; the value is the name that health and metrics show."""

    # messages
    NOT_MSGPACK = "not_msgpack"
    SCHEMA_INVALID = "schema_invalid"
    SCHEMA_TOO_NEW = "schema_too_new"
    WRONG_SHAPE = "wrong_shape"
    NOT_FINITE = "not_finite"
    FOREIGN_CELL = "foreign_cell"
    FUTURE_TIME = "future_time"
    TOO_LARGE = "too_large"
    # corrections
    TOO_OLD = "too_old"
    OUT_OF_ORDER = "out_of_order"
    REPEATED = "repeated"
    UNKNOWN_ID = "unknown_id"
    SUPERSEDED = "superseded"
    """The DLO was re-initialised after the time that the correction speaks of."""
    IMPLAUSIBLE = "implausible"
    """The shape is too far from what the tracker holds, given both uncertainties."""
    OUTVOTED = "outvoted"
    """The shape contradicts a track that the events support."""
    UNCONFIRMED = "unconfirmed"
    """A shape of no known DLO that was not seen often enough yet."""
    # events
    TIME_BACKWARDS = "time_backwards"
    OUT_OF_SENSOR = "out_of_sensor"
    BATCH_DROPPED = "batch_dropped"
    # frames
    FRAME_MISSING = "frame_missing"
    FRAME_UNREADABLE = "frame_unreadable"
    FRAME_WRONG_SIZE = "frame_wrong_size"
    FRAME_WITHOUT_TRIGGER = "frame_without_trigger"
    TRIGGER_WITHOUT_FRAME = "trigger_without_frame"
    SEGMENTATION_FAILED = "segmentation_failed"


class RejectCounter:
    """Counts rejects per reason, and per sender where one is known."""

    def __init__(self) -> None:
        self._by_reason: Counter[str] = Counter()
        self._by_sender: Counter[str] = Counter()

    def count(self, reason: RejectReason, sender: str = "", n: int = 1) -> None:
        """Add ``n`` rejects for ``reason``; ``sender`` is the source named in the message's header, if it has one."""
        self._by_reason[reason.value] += n
        if sender:
            self._by_sender[f"{sender}:{reason.value}"] += n

    def as_dict(self) -> dict[str, int]:
        """Counts per reason, for health."""
        return dict(self._by_reason)

    def senders(self) -> dict[str, int]:
        """Counts per ``sender:reason``, for health."""
        return dict(self._by_sender)
