"""The usual words of EVT3 in a tight loop: rows, single events, and time lows that go on as expected.

In dense data rows and events follow one another at random, so that a branch on the type of the word is predicted
wrongly every other time, which costs more than the rest of the decoding: here one loop does both, without a branch.
"""

from __future__ import annotations

import numba
import numpy as np

from motiondlo.events.time_word_kernels import JITTER_US

_OTHER = 0xD000
"""Bits of the type that are not set in rows (0x0) and events (0x2)."""


@numba.njit(cache=True, nogil=True)
def decode_usual(  # type: ignore[no-untyped-def]
    data, start, end, width, height, out, n, n_done, limit, waits, row, previous, t_us, floor_us, high_us, low,
    low_done, step_us, mean_step,
):  # fmt: skip
    """Decode from ``start`` on to the first word that is not usual; the clock must be believed, and the row known.

    out: (2 N,) int64, see :func:`motiondlo.events.evt3_kernels.decode_evt3`; limit: ``n`` at which events are confirmed
    without a time word; waits: whether a trigger waits for the next time word. Returns where it stopped, whether a row
    and a time low were met, and the rest of what it was given, as it is now.
    """
    words = data[start : start + (end - start) // 2 * 2].view(np.uint16)
    count = min(len(words), max(limit - 1 - n, 0))
    first = n
    lows = 0
    row_bits = row << 16
    i = 0
    while i < count:
        word = np.int64(words[np.uintp(i)])
        while not word & _OTHER:
            place = word & 0x7FF
            event = word >> 13
            if place >= (width if event else height) or (word == previous and not event):
                break
            # Unsigned, so that no index is tested for being negative.
            at = np.uintp(2 * n)
            out[at] = t_us
            out[at + np.uintp(1)] = place | row_bits | ((word & 0x800) << 21)
            n += event
            row_bits = row_bits if event else place << 16
            previous = word
            i += 1
            if i == count:
                break
            word = np.int64(words[np.uintp(i)])
        step = (word & 0xFFF) - low
        if i == count or word >> 12 != 6 or step < 0 or step > JITTER_US:
            break
        floor_us = max(floor_us, t_us if waits or n > n_done else t_us - JITTER_US)
        waits = False
        lows += 1
        n_done = n
        mean_step += step_us - (mean_step >> 4)
        low_done = low
        step_us = step
        low += step
        t_us = max(high_us + low, floor_us)
        previous = word
        i += 1
    rows = i - lows > n - first
    return (
        start + 2 * i, rows, lows > 0, n, n_done, row_bits >> 16, previous, t_us, floor_us, low, low_done, step_us,
        mean_step,
    )  # fmt: skip
