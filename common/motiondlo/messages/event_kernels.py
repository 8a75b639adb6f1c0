"""The check of a batch's events, compiled: one pass instead of five over strided fields."""

from __future__ import annotations

import numba
import numpy as np
import numpy.typing as npt

IN_ORDER = 0
OUT_OF_TIME = 1
OUT_OF_SENSOR = 2


@numba.njit(cache=True, nogil=True)
def check_words(words: npt.NDArray[np.int64], t0_us: int, t1_us: int, width_px: int, height_px: int) -> int:
    """0 if all events are in time order, within [t0_us, t1_us) and on the sensor, else the first fault's code.

    ``words``: (N, 2) int64, an event each: its time, then x | y << 16 | p << 32 (the layout of EVENT_DTYPE).
    """
    last_us = t0_us
    for i in range(words.shape[0]):
        t_us = words[i, 0]
        if t_us < last_us or t_us >= t1_us:
            return OUT_OF_TIME
        last_us = t_us
        where = words[i, 1]
        if (where & 0xFFFF) >= width_px or ((where >> 16) & 0xFFFF) >= height_px or ((where >> 32) & 0xFF) > 1:
            return OUT_OF_SENSOR
    return IN_ORDER
