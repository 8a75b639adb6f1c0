"""The camera's time words: unrolling, and doubt about those that do not follow from the ones before.

Both EVT2 and EVT3 send the upper part of the time ("time high") in words of its own. A time high that repeats the last
one or follows it is believed at once. Any other may be damage, a gap, or a clock that stepped back: it becomes
a suspect, and what is decoded under it is held back until a later time high continues one of the two, or until enough
sound words have followed: damage does not stay sound for long.

Decoder state: (S_COUNT,) int64, indices below. Times are ``(high << low_bits | low) + offset``, ``high`` unrolled.
"""

from __future__ import annotations

import numba
import numpy as np
import numpy.typing as npt

from motiondlo.events.damage import C_GAP, C_TIME_BACKWARDS, C_TIME_OUTLIER, C_WRAP

S_HIGH = 0  # unrolled time high; -1 before the first
S_LOW = 1
S_OFFSET_US = 2  # bridges steps back of the clock
S_SUSPECT = 3  # SUSPECT_*
S_HIGH_BEFORE = 4  # state to return to if the suspect proves wrong
S_LOW_BEFORE = 5
S_OFFSET_BEFORE_US = 6
S_WRAPPED = 7  # the suspect would be a wrap
S_MODE = 8  # MODE_*
S_FLOOR_US = 9  # output time has reached this: nothing earlier will come out
S_T_US = 10  # time of the current group of events
S_N = 11  # events in the output buffer
S_N_DONE = 12  # of which confirmed
S_K = 13  # triggers likewise
S_K_DONE = 14
S_ROW = 15  # ROW_UNKNOWN, ROW_OUTSIDE, or y
S_BASE_X = 16  # -1 unknown
S_BASE_P = 17
S_PREVIOUS = 18  # previous word
S_REPEATS = 19
S_STEP_US = 20  # distance of the current group from the one before
S_MEAN_STEP_16 = 21  # running mean of it, times 16
S_LOW_DONE = 22  # time low of the last confirmed group
S_BUDGET = 23  # words within which a time low alone may end a short damage
S_LOW_BITS = 24
S_HIGH_MOD = 25
S_NEAR = 26  # time highs ahead of another by this much at most speak for it
S_WIDTH = 27
S_HEIGHT = 28
S_WORD = 29  # words decoded so far
S_SUSPECT_WORD = 30  # where the suspect appeared
S_SUSPECT_FRESH = 31  # no time low has come since
S_SUSPECT_LOST = 32  # it appeared right behind damage
S_DAMAGE_WORD = 33  # where decoding went on behind the latest damage
S_COUNT = 34

MODE_START, MODE_SYNC, MODE_NEED_LOW, MODE_NEED_ANY, MODE_NEED_HIGH = 0, 1, 2, 3, 4
ROW_UNKNOWN, ROW_OUTSIDE = -1, -2
SUSPECT_NONE, SUSPECT_AHEAD, SUSPECT_BACK = 0, 1, 2
SUSPECT_LOW = 3  # a time low far ahead: a hole that may have swallowed time highs, which the next one will show

HIGH_REPEATED, HIGH_ADVANCED, HIGH_SUSPECT, HIGH_SUSPECT_STILL = 0, 1, 2, 3
HIGH_DISPROVED = 8

PENDING_MAX = 1 << 18
"""Events held back at most while a time is in doubt; then it is believed."""
TRIGGERS_PENDING_MAX = 1 << 12
SOUND_WORDS = 64
"""Sound words after which a suspect is believed if no time high speaks clearly for it or against it."""
JITTER_US = 64
"""Sensors order their time words to within this (a 1 kHz marker of the IMX636 family is up to 15 us early)."""

_NUMBA = {"cache": True, "nogil": True}
Int64Array = npt.NDArray[np.int64]


@numba.njit(**_NUMBA)
def confirm(state: Int64Array, counts: Int64Array) -> None:
    """Believe the suspect, and count what it was."""
    if state[S_SUSPECT] == SUSPECT_AHEAD:
        counts[C_GAP] += state[S_HIGH] > state[S_HIGH_BEFORE] + 1
        counts[C_WRAP] += state[S_WRAPPED]
    elif state[S_SUSPECT] == SUSPECT_BACK:
        counts[C_TIME_BACKWARDS] += 1
    state[S_SUSPECT] = SUSPECT_NONE


@numba.njit(**_NUMBA)
def disprove(state: Int64Array, counts: Int64Array) -> None:
    """Return to the clock from before the suspect."""
    counts[C_TIME_OUTLIER] += 1
    state[S_HIGH] = state[S_HIGH_BEFORE]
    state[S_LOW] = state[S_LOW_BEFORE]
    state[S_OFFSET_US] = state[S_OFFSET_BEFORE_US]
    state[S_SUSPECT] = SUSPECT_NONE


@numba.njit(**_NUMBA)
def suspect_from_here(state: Int64Array) -> None:
    """Remember the clock as it is, to return to."""
    state[S_HIGH_BEFORE] = state[S_HIGH]
    state[S_LOW_BEFORE] = state[S_LOW]
    state[S_OFFSET_BEFORE_US] = state[S_OFFSET_US]
    state[S_SUSPECT_WORD] = state[S_WORD]
    state[S_SUSPECT_FRESH] = 0
    state[S_SUSPECT_LOST] = state[S_WORD] - state[S_DAMAGE_WORD] < 4 * SOUND_WORDS


@numba.njit(**_NUMBA)
def is_sound(state: Int64Array) -> bool:
    """Whether enough sound words have followed the suspect."""
    return bool(state[S_WORD] - state[S_SUSPECT_WORD] >= SOUND_WORDS)


@numba.njit(**_NUMBA)
def is_dense(state: Int64Array) -> bool:
    """Whether time words follow one another so closely that a leap is remarkable."""
    return bool(state[S_MEAN_STEP_16] <= 16 * JITTER_US // 2)


@numba.njit(**_NUMBA)
def _forward(step: int, mod: int) -> int:
    """A fall by half the range or more is a wrap."""
    return step + mod if step < 0 and -step >= mod // 2 else step


@numba.njit(**_NUMBA)
def time_high(state: Int64Array, counts: Int64Array, value: int) -> int:
    """Take a time-high word; returns HIGH_*, plus HIGH_DISPROVED if what was held back must be dropped.

    A value that falls by half the range or more is a wrap, one that falls by less a step back.
    """
    mod = state[S_HIGH_MOD]
    if state[S_HIGH] < 0:
        state[S_HIGH] = value
        state[S_LOW] = 0
        return HIGH_ADVANCED
    flags = 0
    current = state[S_HIGH] % mod
    if state[S_SUSPECT] == SUSPECT_LOW:
        if (value - current) % mod <= 1:
            confirm(state, counts)
        else:
            disprove(state, counts)
            flags = HIGH_DISPROVED
    elif state[S_SUSPECT] != SUSPECT_NONE:
        before = state[S_HIGH_BEFORE] % mod
        from_suspect = (value - current) % mod
        from_before = (value - before) % mod
        if from_suspect <= from_before:
            step = _forward(value - current, mod)
            if from_suspect > state[S_NEAR] and step > 0 and not is_sound(state):
                # far from both: no damage, if it goes on like this
                state[S_WRAPPED] += step > value - current
                state[S_HIGH] += step
                state[S_LOW] = 0
                return HIGH_SUSPECT_STILL
            confirm(state, counts)
        else:
            disprove(state, counts)
            flags = HIGH_DISPROVED
            current = before
    step = _forward(value - current, mod)
    if step == 0:
        return HIGH_REPEATED | flags
    wrapped = 1 if step > value - current else 0
    if step == 1 and not (is_dense(state) and state[S_LOW] < (1 << state[S_LOW_BITS]) - 4 * JITTER_US):
        state[S_HIGH] += step
        state[S_LOW] = 0
        counts[C_WRAP] += wrapped
        return HIGH_ADVANCED | flags
    suspect_from_here(state)
    state[S_WRAPPED] = wrapped
    state[S_SUSPECT_FRESH] = 1
    now_us = (state[S_HIGH] << state[S_LOW_BITS]) + state[S_LOW] + state[S_OFFSET_US]
    state[S_HIGH] += step
    state[S_LOW] = 0
    if step > 0:
        state[S_SUSPECT] = SUSPECT_AHEAD
    else:
        state[S_SUSPECT] = SUSPECT_BACK
        state[S_OFFSET_US] = now_us - (state[S_HIGH] << state[S_LOW_BITS])
    return HIGH_SUSPECT | flags
