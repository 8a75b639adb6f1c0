"""What a decoder counts: kinds of damage, and marks of the clock that are no damage (wraps, gaps)."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

# Indices into a decoder's counters (C_COUNT,) int64; kernels count, names are for people.
C_RESERVED_WORD = 0
C_REPEATED_WORD = 1
C_SKIPPED_BYTES = 2
C_REALIGNED = 3
C_BEFORE_FIRST_TIME = 4
C_WITHOUT_TIME = 5
C_WITHOUT_ROW = 6
C_WITHOUT_BASE = 7
C_OUT_OF_SENSOR = 8
C_TIME_BACKWARDS = 9
C_TIME_OUTLIER = 10
C_EVENTS_DROPPED = 11
C_TRUNCATED_BYTES = 12
C_WRAP = 13
C_GAP = 14
C_COUNT = 15

_DAMAGE_NAMES = {
    C_RESERVED_WORD: "reserved_word",  # a word type that the format does not have
    C_REPEATED_WORD: "repeated_word",  # the same word over and over: a hole filled with zeros or ones
    C_SKIPPED_BYTES: "skipped_bytes",  # bytes passed over in search of undamaged data
    C_REALIGNED: "realigned",  # undamaged data went on at another byte alignment
    C_BEFORE_FIRST_TIME: "words_before_first_time",  # the stream began in the middle
    C_WITHOUT_TIME: "words_without_time",  # after damage, until the next time word
    C_WITHOUT_ROW: "words_without_row",  # after damage, until the next row word
    C_WITHOUT_BASE: "words_without_base",  # after damage, vectors until the next vector base
    C_OUT_OF_SENSOR: "out_of_sensor",  # events
    C_TIME_BACKWARDS: "time_backwards",  # the clock stepped back; output time goes on from where it was
    C_TIME_OUTLIER: "time_outlier",  # a time word that the next ones contradict
    C_EVENTS_DROPPED: "events_dropped",  # events and triggers decoded under such a time word
    C_TRUNCATED_BYTES: "truncated_bytes",  # an incomplete word at the end
}
_MARK_NAMES = {C_WRAP: "wraps", C_GAP: "gaps"}


def damage_counts(counters: npt.NDArray[np.int64]) -> dict[str, int]:
    """Counts per kind of damage, without the kinds that did not occur. counters: (C_COUNT,) int64."""
    return {name: int(counters[i]) for i, name in _DAMAGE_NAMES.items() if counters[i]}


def clock_marks(counters: npt.NDArray[np.int64]) -> dict[str, int]:
    """How often the camera's counter wrapped, and how often its time words skipped ahead (silence or loss)."""
    return {name: int(counters[i]) for i, name in _MARK_NAMES.items()}
