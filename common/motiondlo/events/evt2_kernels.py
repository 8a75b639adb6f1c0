"""The EVT2 and EVT2.1 state machines, one pass, no allocation.

EVT2, 32-bit words: type (4 bits), time low (6), x (11), y (11); EVT2.1, 64-bit words: the same as the upper half, and a
mask of 32 pixels from x on as the lower. Types: 0x0 / 0x1 event off / on, 0x8 time high (28 bits, 64 us each), 0xA
external trigger (channel in bits 8-12, edge in bit 0), 0xE others, 0xF continuation; the rest does not exist.
Every event carries its position and its time low, so damage costs little: the next time high ends it.
"""

from __future__ import annotations

import numba
import numpy as np
import numpy.typing as npt

from motiondlo.events.damage import (
    C_BEFORE_FIRST_TIME,
    C_EVENTS_DROPPED,
    C_OUT_OF_SENSOR,
    C_REPEATED_WORD,
    C_RESERVED_WORD,
    C_TIME_BACKWARDS,
    C_WITHOUT_TIME,
)
from motiondlo.events.time_word_kernels import (
    HIGH_DISPROVED,
    HIGH_SUSPECT_STILL,
    JITTER_US,
    MODE_NEED_HIGH,
    MODE_START,
    MODE_SYNC,
    PENDING_MAX,
    S_FLOOR_US,
    S_HEIGHT,
    S_HIGH,
    S_K,
    S_K_DONE,
    S_LOW,
    S_MODE,
    S_N,
    S_N_DONE,
    S_OFFSET_US,
    S_PREVIOUS,
    S_REPEATS,
    S_SUSPECT,
    S_T_US,
    S_WIDTH,
    S_WORD,
    SUSPECT_NONE,
    TRIGGERS_PENDING_MAX,
    confirm,
    disprove,
    is_sound,
    time_high,
)

Int64Array = npt.NDArray[np.int64]
ByteArray = npt.NDArray[np.uint8]

_NUMBA = {"cache": True, "nogil": True}


@numba.njit(**_NUMBA)
def _commit(state: Int64Array) -> None:
    if state[S_N] > state[S_N_DONE] or state[S_K] > state[S_K_DONE]:
        state[S_FLOOR_US] = max(state[S_FLOOR_US], state[S_T_US])
    state[S_N_DONE] = state[S_N]
    state[S_K_DONE] = state[S_K]


@numba.njit(**_NUMBA)
def _drop(state: Int64Array, counts: Int64Array) -> None:
    counts[C_EVENTS_DROPPED] += state[S_N] - state[S_N_DONE] + state[S_K] - state[S_K_DONE]
    state[S_N] = state[S_N_DONE]
    state[S_K] = state[S_K_DONE]
    state[S_T_US] = state[S_FLOOR_US]


@numba.njit(**_NUMBA)
def _time_high(state: Int64Array, counts: Int64Array, value: int) -> None:
    started = state[S_MODE] != MODE_START
    before_us = (state[S_HIGH] << 6) + state[S_OFFSET_US]
    state[S_LOW] = max(state[S_T_US] - before_us, 0)
    result = time_high(state, counts, value)
    if result & HIGH_DISPROVED:
        _drop(state, counts)
    elif result != HIGH_SUSPECT_STILL:
        _commit(state)
        if started:
            # all that belongs to the time high before has come
            state[S_FLOOR_US] = max(state[S_FLOOR_US], before_us - JITTER_US)
    state[S_MODE] = MODE_SYNC
    state[S_T_US] = max(state[S_T_US], state[S_FLOOR_US])


@numba.njit(**_NUMBA)
def _settle_before_damage(state: Int64Array, counts: Int64Array) -> None:
    if state[S_SUSPECT] != SUSPECT_NONE and not is_sound(state):
        disprove(state, counts)
        _drop(state, counts)
    else:
        confirm(state, counts)
        _commit(state)
    if state[S_MODE] != MODE_START:
        state[S_MODE] = MODE_NEED_HIGH
    state[S_PREVIOUS] = -1
    state[S_REPEATS] = 0


@numba.njit(**_NUMBA)
def _half(data: ByteArray, at: int) -> int:
    low = np.int64(data[at]) | (np.int64(data[at + 1]) << 8)
    return int(low | (np.int64(data[at + 2]) << 16) | (np.int64(data[at + 3]) << 24))


@numba.njit(**_NUMBA)
def _decode(
    data: ByteArray,
    start: int,
    end: int,
    word_bytes: int,
    head: int,
    state: Int64Array,
    counts: Int64Array,
    out: Int64Array,
    triggers: Int64Array,
) -> int:
    pos = start
    n = state[S_N]
    k = state[S_K]
    t_us = state[S_T_US]
    high_us = (state[S_HIGH] << 6) + state[S_OFFSET_US]
    previous = state[S_PREVIOUS]
    word_before = state[S_WORD]
    synced = state[S_MODE] == MODE_SYNC
    limit = state[S_N_DONE] + PENDING_MAX
    width = state[S_WIDTH]
    height = state[S_HEIGHT]
    damaged = 0
    while pos + word_bytes <= end:
        word = _half(data, pos + head)
        mask = np.int64(1) if word_bytes == 4 else _half(data, pos + 4 - head)
        kind = word >> 28
        if word == previous and kind != 8:
            # the same pixels at the same microsecond: a hole filled with one value
            state[S_REPEATS] += 1
            if state[S_REPEATS] >= 2 and (word_bytes == 4 or mask in (0, 0xFFFFFFFF)):
                damaged = C_REPEATED_WORD + 1
                break
        else:
            state[S_REPEATS] = 0
        if kind <= 1:
            if synced:
                event_us = high_us + ((word >> 22) & 0x3F)
                if event_us < t_us:
                    if event_us < t_us - JITTER_US or (t_us & 0x3F) != 0:
                        counts[C_TIME_BACKWARDS] += 1
                    event_us = t_us
                t_us = event_us
                x = (word >> 11) & 0x7FF
                y = word & 0x7FF
                rest = (y << 16) | (kind << 32)
                while mask != 0:
                    if mask & 1:
                        if x < width and y < height:
                            out[n, 0] = event_us
                            out[n, 1] = x | rest
                            n += 1
                        else:
                            counts[C_OUT_OF_SENSOR] += 1
                    mask >>= 1
                    x += 1
            else:
                counts[C_BEFORE_FIRST_TIME if state[S_MODE] == MODE_START else C_WITHOUT_TIME] += 1
        elif kind == 8:
            state[S_N], state[S_K], state[S_T_US] = n, k, t_us
            state[S_WORD] = word_before + (pos - start) // word_bytes
            _time_high(state, counts, word & 0xFFFFFFF)
            n, k, t_us = state[S_N], state[S_K], state[S_T_US]
            high_us = (state[S_HIGH] << 6) + state[S_OFFSET_US]
            limit = state[S_N_DONE] + PENDING_MAX
            synced = True
        elif kind == 10:
            if synced:
                t_us = max(t_us, high_us + ((word >> 22) & 0x3F))
                triggers[k, 0] = t_us
                triggers[k, 1] = ((word >> 8) & 0x1F) | ((word & 1) << 8)
                k += 1
            else:
                counts[C_BEFORE_FIRST_TIME if state[S_MODE] == MODE_START else C_WITHOUT_TIME] += 1
        elif kind < 14:
            damaged = C_RESERVED_WORD + 1
            break
        if n >= limit or k >= state[S_K_DONE] + TRIGGERS_PENDING_MAX:
            state[S_N], state[S_K], state[S_T_US] = n, k, t_us
            confirm(state, counts)
            _commit(state)
            limit = n + PENDING_MAX
        previous = word
        pos += word_bytes
    state[S_N], state[S_K], state[S_T_US] = n, k, t_us
    state[S_PREVIOUS] = previous
    state[S_WORD] = word_before + (pos - start) // word_bytes
    if damaged:
        counts[damaged - 1] += 1
        _settle_before_damage(state, counts)
    return pos


@numba.njit(**_NUMBA)
def decode_evt2(
    data: ByteArray, start: int, end: int, state: Int64Array, counts: Int64Array, out: Int64Array, triggers: Int64Array
) -> int:
    """Decode whole words of ``data[start:end]``; returns where it stopped: the end, or the word that shows damage.

    out: (N, 2) int64, room for an event a word; column 0 time, column 1 ``x | y << 16 | polarity << 32``.
    triggers: (K, 2) int64, room for one a word; column 1 ``channel | edge << 8``.
    """
    return int(_decode(data, start, end, 4, 0, state, counts, out, triggers))


@numba.njit(**_NUMBA)
def decode_evt21(
    data: ByteArray, start: int, end: int, state: Int64Array, counts: Int64Array, out: Int64Array, triggers: Int64Array
) -> int:
    """As :func:`decode_evt2`, room for 32 events a word."""
    return int(_decode(data, start, end, 8, 4, state, counts, out, triggers))


@numba.njit(**_NUMBA)
def decode_evt21_swapped(
    data: ByteArray, start: int, end: int, state: Int64Array, counts: Int64Array, out: Int64Array, triggers: Int64Array
) -> int:
    """EVT2.1 as some sensors send it: the upper half of the word first (``endianness=legacy``)."""
    return int(_decode(data, start, end, 8, 0, state, counts, out, triggers))


@numba.njit(**_NUMBA)
def resume_evt2(state: Int64Array, skipped_bytes: int) -> None:
    """Nothing to do: decoding goes on at the next time high, however long the damage was."""
