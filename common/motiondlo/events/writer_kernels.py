"""Encode events and triggers as EVT3 words, one pass."""

from __future__ import annotations

import numba
import numpy as np
import numpy.typing as npt

Int64Array = npt.NDArray[np.int64]
Uint16Array = npt.NDArray[np.uint16]

# Encoder state: time high and low last written (-1: none), row, reached index of events and of triggers.
W_HIGH, W_LOW, W_ROW = 0, 1, 2
W_COUNT = 3

WORDS_PER_ITEM = 6
"""Most words that an event or trigger needs besides silent time highs: high, low, row, base and two for its vector."""
VECTOR_SPAN_PX = 32
_VECTOR_LEAST = 4
_NUMBA = {"cache": True, "nogil": True}


@numba.njit(**_NUMBA)
def _write_time(t_us: int, words: Uint16Array, n: int, state: Int64Array) -> int:
    high = t_us >> 12
    low = t_us & 0xFFF
    if high != state[W_HIGH]:
        # Every time high in between too: a reader can tell a long silence from a wrap or from loss only by them.
        first = state[W_HIGH] + 1 if state[W_HIGH] >= 0 else high
        for value in range(first, high + 1):
            words[n] = 0x8000 | (value & 0xFFF)
            n += 1
        state[W_HIGH] = high
        state[W_LOW] = -1
    if low != state[W_LOW]:
        words[n] = 0x6000 | low
        n += 1
        state[W_LOW] = low
    return n


@numba.njit(**_NUMBA)
def _vector_reach(events: Int64Array, i: int) -> int:
    """End of the longest sequence from ``i`` on that one vector base can carry: same time, row, polarity; x rising."""
    first = events[i, 1]
    x0 = first & 0xFFFF
    last_x = x0
    j = i + 1
    while j < len(events) and events[j, 0] == events[i, 0]:
        place = events[j, 1]
        x = place & 0xFFFF
        if (place ^ first) & 0x1_FFFF_0000 or x <= last_x or x >= x0 + VECTOR_SPAN_PX:
            break
        last_x = x
        j += 1
    return j


@numba.njit(**_NUMBA)
def encode_evt3(events: Int64Array, triggers: Int64Array, words: Uint16Array, state: Int64Array) -> int:
    """Merge events and triggers by time into EVT3 words; a trigger goes before events of the same time.

    events: (N, 2) int64, time and ``x | y << 16 | polarity << 32``; triggers: (K, 2), ``channel | edge << 8``; both in
    time order. words: large enough, see WORDS_PER_ITEM. state: (W_COUNT,). Returns the number of words.
    """
    n = 0
    i = 0
    k = 0
    while i < len(events) or k < len(triggers):
        if k < len(triggers) and (i >= len(events) or triggers[k, 0] <= events[i, 0]):
            n = _write_time(triggers[k, 0], words, n, state)
            what = triggers[k, 1]
            words[n] = 0xA000 | ((what & 0xF) << 8) | ((what >> 8) & 1)
            n += 1
            k += 1
            continue
        n = _write_time(events[i, 0], words, n, state)
        place = events[i, 1]
        x = place & 0x7FF
        row = (place >> 16) & 0x7FF
        polarity = (place >> 32) & 1
        if row != state[W_ROW]:
            words[n] = row
            n += 1
            state[W_ROW] = row
        end = _vector_reach(events, i)
        if end - i < _VECTOR_LEAST:
            words[n] = 0x2000 | (polarity << 11) | x
            n += 1
            i += 1
            continue
        mask = np.int64(0)
        for j in range(i, end):
            mask |= np.int64(1) << ((events[j, 1] & 0xFFFF) - x)
        words[n] = 0x3000 | (polarity << 11) | x
        words[n + 1] = 0x4000 | (mask & 0xFFF)
        n += 2
        if mask >> 12:
            words[n] = 0x4000 | ((mask >> 12) & 0xFFF)
            n += 1
        if mask >> 24:
            words[n] = 0x5000 | (mask >> 24)
            n += 1
        i = end
    return n
