"""The EVT3 state machine (16-bit words), one pass, no allocation.

Word types: 0x0 row, 0x2 event, 0x3 vector base, 0x4 / 0x5 vectors of 12 / 8 pixels, 0x6 / 0x8 time low / high,
0xA external trigger, 0x7 / 0xF continuation, 0xD inertial data, 0xE others; 0x1, 0x9, 0xB, 0xC do not exist.

Events are confirmed group by group: a group is what follows one time low, and the next time word confirms it. So a
time word made up by damage is recognised before anything decoded under it has left the decoder.
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
    C_TIME_OUTLIER,
    C_WITHOUT_BASE,
    C_WITHOUT_ROW,
    C_WITHOUT_TIME,
)
from motiondlo.events.evt3_usual_kernels import decode_usual
from motiondlo.events.time_word_kernels import (
    HIGH_DISPROVED,
    HIGH_REPEATED,
    HIGH_SUSPECT_STILL,
    JITTER_US,
    MODE_NEED_ANY,
    MODE_NEED_HIGH,
    MODE_NEED_LOW,
    MODE_START,
    MODE_SYNC,
    PENDING_MAX,
    ROW_OUTSIDE,
    ROW_UNKNOWN,
    S_BASE_P,
    S_BASE_X,
    S_BUDGET,
    S_FLOOR_US,
    S_HEIGHT,
    S_HIGH,
    S_K,
    S_K_DONE,
    S_LOW,
    S_LOW_BEFORE,
    S_LOW_DONE,
    S_MEAN_STEP_16,
    S_MODE,
    S_N,
    S_N_DONE,
    S_OFFSET_US,
    S_PREVIOUS,
    S_REPEATS,
    S_ROW,
    S_STEP_US,
    S_SUSPECT,
    S_SUSPECT_FRESH,
    S_T_US,
    S_WIDTH,
    S_WORD,
    SUSPECT_AHEAD,
    SUSPECT_BACK,
    SUSPECT_LOW,
    SUSPECT_NONE,
    TRIGGERS_PENDING_MAX,
    confirm,
    disprove,
    is_dense,
    is_sound,
    suspect_from_here,
    time_high,
)

Int64Array = npt.NDArray[np.int64]
ByteArray = npt.NDArray[np.uint8]

SHORT_DAMAGE_WORDS = 64
USUAL_BYTES, PAUSE_BYTES = 32, 128
"""A run of usual words that is shorter than the first is followed by a pause of the second in looking for runs."""
_NUMBA = {"cache": True, "nogil": True}


@numba.njit(**_NUMBA)
def _commit(state: Int64Array) -> None:
    t_us = state[S_T_US]
    floor = t_us if state[S_N] > state[S_N_DONE] or state[S_K] > state[S_K_DONE] else t_us - JITTER_US
    state[S_FLOOR_US] = max(state[S_FLOOR_US], floor)
    state[S_N_DONE] = state[S_N]
    state[S_K_DONE] = state[S_K]


@numba.njit(**_NUMBA)
def _drop(state: Int64Array, counts: Int64Array) -> None:
    counts[C_EVENTS_DROPPED] += state[S_N] - state[S_N_DONE] + state[S_K] - state[S_K_DONE]
    state[S_N] = state[S_N_DONE]
    state[S_K] = state[S_K_DONE]


@numba.njit(**_NUMBA)
def _set_time(state: Int64Array) -> None:
    t_us = ((state[S_HIGH] << 12) | state[S_LOW]) + state[S_OFFSET_US]
    state[S_T_US] = max(t_us, state[S_FLOOR_US])


@numba.njit(**_NUMBA)
def _step_is_usual(state: Int64Array, step_us: int) -> bool:
    return bool(step_us <= max(JITTER_US, state[S_MEAN_STEP_16] // 2))


@numba.njit(**_NUMBA)
def _lose_place(state: Int64Array, mode: int) -> None:
    state[S_MODE] = mode
    state[S_BUDGET] = SHORT_DAMAGE_WORDS
    state[S_ROW] = ROW_UNKNOWN
    state[S_BASE_X] = -1
    state[S_REPEATS] = 0
    state[S_PREVIOUS] = -1


@numba.njit(**_NUMBA)
def _revert(state: Int64Array, counts: Int64Array) -> None:
    disprove(state, counts)
    _drop(state, counts)
    _set_time(state)


@numba.njit(**_NUMBA)
def settle_before_damage(state: Int64Array, counts: Int64Array) -> None:
    """Keep or drop the group that was being decoded when damage showed: keep it if its time is in line."""
    if state[S_SUSPECT] != SUSPECT_NONE and not is_sound(state):
        _revert(state, counts)
    elif state[S_MODE] == MODE_SYNC:
        confirm(state, counts)
        if _step_is_usual(state, state[S_STEP_US]):
            _commit(state)
        else:
            _drop(state, counts)
            state[S_LOW] = state[S_LOW_DONE]
            _set_time(state)
    _lose_place(state, MODE_START if state[S_MODE] == MODE_START else MODE_NEED_ANY)


@numba.njit(**_NUMBA)
def _time_low(state: Int64Array, counts: Int64Array, low: int) -> None:
    mode = state[S_MODE]
    if mode == MODE_SYNC:
        suspect = state[S_SUSPECT]
        if suspect in (SUSPECT_AHEAD, SUSPECT_BACK) and state[S_SUSPECT_FRESH]:
            state[S_SUSPECT_FRESH] = 0
            if is_dense(state) and 0 <= low - state[S_LOW_BEFORE] <= JITTER_US:
                # time goes on as if there had been no time high: it was made up
                _revert(state, counts)
        elif (
            suspect == SUSPECT_LOW
            and low < state[S_LOW]
            and state[S_N] + state[S_K] > state[S_N_DONE] + state[S_K_DONE]
        ):
            _revert(state, counts)
        suspect = state[S_SUSPECT]
        last = state[S_LOW]
        step = low - last
        if step >= 0:
            if suspect == SUSPECT_NONE:
                _commit(state)
                state[S_MEAN_STEP_16] += state[S_STEP_US] - (state[S_MEAN_STEP_16] >> 4)
                state[S_LOW_DONE] = last
                if is_dense(state) and step > 2 * JITTER_US and not _step_is_usual(state, step):
                    suspect_from_here(state)
                    state[S_SUSPECT] = SUSPECT_LOW
            state[S_STEP_US] = step
        elif step >= -JITTER_US and state[S_N] == state[S_N_DONE] and state[S_K] == state[S_K_DONE]:
            # harmless disorder of markers
            state[S_STEP_US] = max(state[S_STEP_US] + step, 0)
        elif step >= -JITTER_US and suspect != SUSPECT_NONE:
            counts[C_TIME_BACKWARDS] += 1
            return
        elif step >= -JITTER_US and low < state[S_LOW_DONE]:
            # this word is out of line: what follows it is skipped, the place is kept
            counts[C_TIME_BACKWARDS] += 1
            _commit(state)
            state[S_MODE] = MODE_NEED_ANY
            state[S_BUDGET] = SHORT_DAMAGE_WORDS
            return
        elif step >= -JITTER_US:
            # the word before was out of line
            counts[C_TIME_BACKWARDS] += 1
            _drop(state, counts)
            state[S_STEP_US] = low - state[S_LOW_DONE]
        elif suspect != SUSPECT_NONE:
            _revert(state, counts)
            _lose_place(state, MODE_NEED_HIGH)
            return
        elif low >= state[S_LOW_DONE] and not _step_is_usual(state, state[S_STEP_US]):
            counts[C_TIME_OUTLIER] += 1
            _drop(state, counts)
            state[S_STEP_US] = low - state[S_LOW_DONE]
        else:
            # either this word is wrong, or a time high was lost
            counts[C_TIME_OUTLIER] += 1
            _commit(state)
            _lose_place(state, MODE_NEED_ANY)
            return
        state[S_LOW] = low
        _set_time(state)
    elif mode == MODE_NEED_LOW:
        if ((state[S_HIGH] << 12) | low) + state[S_OFFSET_US] < state[S_FLOOR_US] - JITTER_US:
            state[S_MODE] = MODE_NEED_HIGH
            return
        state[S_LOW] = state[S_LOW_DONE] = low
        state[S_STEP_US] = 0
        state[S_MODE] = MODE_SYNC
        _set_time(state)
    elif mode == MODE_NEED_ANY:
        step = low - state[S_LOW]
        if state[S_BUDGET] > 0 and step >= 0 and _step_is_usual(state, step):
            state[S_STEP_US] = step
            state[S_LOW_DONE] = state[S_LOW]
            state[S_LOW] = low
            state[S_MODE] = MODE_SYNC
            _set_time(state)
        else:
            state[S_MODE] = MODE_NEED_HIGH


@numba.njit(**_NUMBA)
def _time_high(state: Int64Array, counts: Int64Array, value: int) -> None:
    mode = state[S_MODE]
    result = time_high(state, counts, value)
    if result & HIGH_DISPROVED:
        _drop(state, counts)
        state[S_MODE] = MODE_NEED_LOW
        result -= HIGH_DISPROVED
    elif result != HIGH_SUSPECT_STILL:
        # before a suspect begins this confirms what belongs to the clock as it was
        _commit(state)
        if mode == MODE_START:
            state[S_MODE] = MODE_SYNC
        elif mode != MODE_SYNC:
            state[S_MODE] = MODE_NEED_LOW
    if result != HIGH_REPEATED:
        state[S_LOW_DONE] = 0
        state[S_STEP_US] = 0
    _set_time(state)


@numba.njit(**_NUMBA)
def decode_evt3(
    data: ByteArray, start: int, end: int, state: Int64Array, counts: Int64Array, out: Int64Array, triggers: Int64Array
) -> int:
    """Decode whole words of ``data[start:end]``; returns where it stopped: the end, or the word that shows damage.

    out: (N, 2) int64, room for 12 events a word; column 0 time, column 1 ``x | y << 16 | polarity << 32``.
    triggers: (K, 2) int64, room for one a word; column 1 ``channel | edge << 8``.
    """
    pos = start
    n = state[S_N]
    k = state[S_K]
    t_us = state[S_T_US]
    row = state[S_ROW]
    base_x = state[S_BASE_X]
    base_p = state[S_BASE_P]
    previous = state[S_PREVIOUS]
    word_before = state[S_WORD]
    n_done = state[S_N_DONE]
    k_done = state[S_K_DONE]
    floor_us = state[S_FLOOR_US]
    low = state[S_LOW]
    low_done = state[S_LOW_DONE]
    step_us = state[S_STEP_US]
    mean_step = state[S_MEAN_STEP_16]
    high_us = (state[S_HIGH] << 12) + state[S_OFFSET_US]
    synced = state[S_MODE] == MODE_SYNC
    believed = synced and state[S_SUSPECT] == SUSPECT_NONE
    limit = n_done + PENDING_MAX
    width = state[S_WIDTH]
    height = state[S_HEIGHT]
    damaged = False
    try_at = pos
    flat = out.reshape(-1)
    while pos + 1 < end:
        word = np.int64(data[pos]) | (np.int64(data[pos + 1]) << 8)
        kind = word >> 12
        if believed and pos >= try_at and row >= 0 and kind & ~2 == 0:
            first = pos
            pos, rows, lows, n, n_done, row, previous, t_us, floor_us, low, low_done, step_us, mean_step = decode_usual(
                data, pos, end, width, height, flat, n, n_done, limit, k > k_done, row, previous, t_us, floor_us,
                high_us, low, low_done, step_us, mean_step,
            )  # fmt: skip
            if rows:
                state[S_REPEATS] = 0
            if lows:
                k_done = k
                limit = n_done + PENDING_MAX
            # Where other words are frequent the attempt costs more than it saves. Always a word further than here.
            try_at = pos + (2 if pos - first >= USUAL_BYTES else PAUSE_BYTES)
            continue
        if kind == 2:
            if synced and row >= 0:
                x = word & 0x7FF
                if x < width:
                    out[n, 0] = t_us
                    out[n, 1] = x | (row << 16) | (((word >> 11) & 1) << 32)
                    n += 1
                else:
                    counts[C_OUT_OF_SENSOR] += 1
            elif not synced:
                counts[C_BEFORE_FIRST_TIME if state[S_MODE] == MODE_START else C_WITHOUT_TIME] += 1
                state[S_BUDGET] -= 1
            else:
                counts[C_OUT_OF_SENSOR if row == ROW_OUTSIDE else C_WITHOUT_ROW] += 1
        elif kind == 0:
            row = word & 0x7FF
            if row >= height:
                row = ROW_OUTSIDE
            if word == previous:
                state[S_REPEATS] += 1
                if state[S_REPEATS] >= 2:
                    damaged = True
                    break
            else:
                state[S_REPEATS] = 0
        elif 4 <= kind <= 5:
            bits = 12 if kind == 4 else 8
            if not synced:
                counts[C_BEFORE_FIRST_TIME if state[S_MODE] == MODE_START else C_WITHOUT_TIME] += 1
                state[S_BUDGET] -= 1
            elif base_x < 0:
                counts[C_WITHOUT_BASE] += 1
            elif row == ROW_UNKNOWN:
                counts[C_WITHOUT_ROW] += 1
            elif row >= 0 and base_x + bits <= width:
                rest = (row << 16) | (base_p << 32)
                for i in range(bits):
                    # Written whether it fired or not: a branch would be predicted wrongly every other time.
                    out[n, 0] = t_us
                    out[n, 1] = (base_x + i) | rest
                    n += (word >> i) & 1
            else:
                rest = (row << 16) | (base_p << 32)
                for i in range(bits):
                    if (word >> i) & 1:
                        x = base_x + i
                        if x < width and row >= 0:
                            out[n, 0] = t_us
                            out[n, 1] = x | rest
                            n += 1
                        else:
                            counts[C_OUT_OF_SENSOR] += 1
            if base_x >= 0:
                base_x += bits
        elif kind == 3:
            base_x = word & 0x7FF
            base_p = (word >> 11) & 1
        elif kind == 6 and believed and 0 <= (word & 0xFFF) - low <= JITTER_US:
            # _time_low for the usual case, kept in registers
            if n > n_done or k > k_done:
                floor_us = max(floor_us, t_us)
            else:
                floor_us = max(floor_us, t_us - JITTER_US)
            n_done = n
            k_done = k
            limit = n + PENDING_MAX
            mean_step += step_us - (mean_step >> 4)
            low_done = low
            step_us = (word & 0xFFF) - low
            low = word & 0xFFF
            t_us = max(high_us + low, floor_us)
        elif kind in (6, 8):
            state[S_N], state[S_K], state[S_N_DONE], state[S_K_DONE] = n, k, n_done, k_done
            state[S_ROW], state[S_BASE_X], state[S_T_US], state[S_FLOOR_US] = row, base_x, t_us, floor_us
            state[S_LOW], state[S_LOW_DONE], state[S_STEP_US], state[S_MEAN_STEP_16] = low, low_done, step_us, mean_step
            state[S_WORD] = word_before + (pos - start) // 2
            if kind == 6:
                _time_low(state, counts, word & 0xFFF)
            else:
                _time_high(state, counts, word & 0xFFF)
            n, k, n_done, k_done = state[S_N], state[S_K], state[S_N_DONE], state[S_K_DONE]
            row, base_x, t_us, floor_us = state[S_ROW], state[S_BASE_X], state[S_T_US], state[S_FLOOR_US]
            low, low_done, step_us, mean_step = state[S_LOW], state[S_LOW_DONE], state[S_STEP_US], state[S_MEAN_STEP_16]
            limit = n_done + PENDING_MAX
            high_us = (state[S_HIGH] << 12) + state[S_OFFSET_US]
            synced = state[S_MODE] == MODE_SYNC
            believed = synced and state[S_SUSPECT] == SUSPECT_NONE
        elif kind == 10:
            if synced:
                triggers[k, 0] = t_us
                triggers[k, 1] = ((word >> 8) & 0xF) | ((word & 1) << 8)
                k += 1
            else:
                counts[C_BEFORE_FIRST_TIME if state[S_MODE] == MODE_START else C_WITHOUT_TIME] += 1
        elif kind == 7 or kind >= 13:
            if word == previous:
                state[S_REPEATS] += 1
                if state[S_REPEATS] >= 8:
                    damaged = True
                    break
            else:
                state[S_REPEATS] = 0
        else:
            damaged = True
            break
        if n >= limit or k >= k_done + TRIGGERS_PENDING_MAX:
            confirm(state, counts)
            believed = synced
            floor_us = max(floor_us, t_us)
            n_done = n
            k_done = k
            limit = n + PENDING_MAX
        previous = word
        pos += 2
    state[S_N], state[S_K], state[S_N_DONE], state[S_K_DONE] = n, k, n_done, k_done
    state[S_ROW], state[S_BASE_X], state[S_T_US], state[S_FLOOR_US] = row, base_x, t_us, floor_us
    state[S_LOW], state[S_LOW_DONE], state[S_STEP_US], state[S_MEAN_STEP_16] = low, low_done, step_us, mean_step
    state[S_BASE_P] = base_p
    state[S_PREVIOUS] = previous
    state[S_WORD] = word_before + (pos - start) // 2
    if damaged:
        word = np.int64(data[pos]) | (np.int64(data[pos + 1]) << 8)
        counts[C_REPEATED_WORD if word == previous else C_RESERVED_WORD] += 1
        settle_before_damage(state, counts)
    return pos


@numba.njit(**_NUMBA)
def resume_evt3(state: Int64Array, skipped_bytes: int) -> None:
    """Go on behind ``skipped_bytes`` of damage: a long hole may have swallowed a time high, a short one hardly."""
    if state[S_MODE] != MODE_START and skipped_bytes > 16:
        state[S_MODE] = MODE_NEED_HIGH
