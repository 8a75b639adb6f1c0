"""Search for undamaged data behind damage, at every byte alignment.

Legend: a *run* is a sequence of words at one alignment that are all plausible. The first alignment whose run reaches
``RUN_WORDS`` wins, the alignment from before the damage at equal length, and decoding resumes where that run began.
"""

from __future__ import annotations

import numba
import numpy as np
import numpy.typing as npt

Int64Array = npt.NDArray[np.int64]
ByteArray = npt.NDArray[np.uint8]

FORMAT_EVT3, FORMAT_EVT2, FORMAT_EVT21, FORMAT_EVT21_SWAPPED = 0, 1, 2, 3

# Random data passes by chance with probability 0.75 a word in EVT3, 0.375 in EVT2 and EVT2.1.
RUN_WORDS = 48
RUN_WORDS_AT_END = 12
"""What is enough where the stream ends."""

# Per alignment: length of the run, previous word, last time low, last time high.
R_LENGTH, R_PREVIOUS, R_LOW, R_HIGH = 0, 1, 2, 3
R_COUNT = 4

_EVT3_TYPES = 0b1110_0101_0111_1101
_EVT2_TYPES = 0b1100_0101_0000_0011
_JITTER = 64
_NUMBA = {"cache": True, "nogil": True}


@numba.njit(**_NUMBA)
def _plausible_evt3(data: ByteArray, at: int, run: Int64Array) -> bool:
    word = np.int64(data[at]) | np.int64(data[at + 1]) << 8
    kind = word >> 12
    value = word & 0xFFF
    if (_EVT3_TYPES >> kind) & 1 == 0:
        return False
    fresh = run[R_LENGTH] == 0
    if not fresh and word == run[R_PREVIOUS] and kind in (0, 7, 15):
        return False
    low = np.int64(-1) if fresh else run[R_LOW]
    high = np.int64(-1) if fresh else run[R_HIGH]
    if kind == 6:
        if value < low - _JITTER:
            return False
        low = value
    elif kind == 8:
        if high >= 0 and 0 < high - value < 2048:
            return False
        if value != high:
            low = np.int64(-1)
        high = value
    run[R_PREVIOUS], run[R_LOW], run[R_HIGH] = word, low, high
    return True


@numba.njit(**_NUMBA)
def _plausible_evt2(data: ByteArray, at: int, run: Int64Array, head: int) -> bool:
    # head: where the 32-bit half that carries the type begins (EVT2: the word itself)
    word = np.int64(0)
    for i in range(4):
        word |= np.int64(data[at + head + i]) << (8 * i)
    kind = word >> 28
    value = word & 0xFFFFFFF
    if (_EVT2_TYPES >> kind) & 1 == 0:
        return False
    fresh = run[R_LENGTH] == 0
    if not fresh and word == run[R_PREVIOUS] and kind != 8:
        return False
    high = np.int64(-1) if fresh else run[R_HIGH]
    if kind == 8:
        if high >= 0 and 0 < high - value < 1 << 27:
            return False
        high = value
    run[R_PREVIOUS], run[R_HIGH] = word, high
    return True


@numba.njit(**_NUMBA)
def find_run(data: ByteArray, start: int, end: int, fmt: int, word_bytes: int, runs: Int64Array) -> tuple[int, int]:
    """Scan word by word from ``start``; stops at the first run of RUN_WORDS, or where a whole row of words is missing.

    data: bytes; runs: (word_bytes, R_COUNT) int64, kept between calls; row a is the alignment ``start + a``.
    Returns (where the run began or -1, where to go on scanning).
    """
    pos = start
    while pos + 2 * word_bytes - 1 <= end:
        for a in range(word_bytes):
            run = runs[a]
            at = pos + a
            if fmt == FORMAT_EVT3:
                good = _plausible_evt3(data, at, run)
            elif fmt == FORMAT_EVT21:
                good = _plausible_evt2(data, at, run, 4)
            else:
                good = _plausible_evt2(data, at, run, 0)
            run[R_LENGTH] = run[R_LENGTH] + 1 if good else 0
            if run[R_LENGTH] >= RUN_WORDS:
                return at - (RUN_WORDS - 1) * word_bytes, pos
        pos += word_bytes
    return -1, pos
