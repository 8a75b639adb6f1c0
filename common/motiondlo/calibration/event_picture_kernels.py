"""The leaky sum of event polarities, a picture of the brightness as far as the events tell it."""

from __future__ import annotations

import numba
import numpy as np
import numpy.typing as npt


@numba.njit(cache=True, nogil=True)
def leak_and_add(
    x: npt.NDArray[np.uint16],
    y: npt.NDArray[np.uint16],
    p: npt.NDArray[np.generic],
    t: npt.NDArray[np.int64],
    tau_us: float,
    level: npt.NDArray[np.float32],
    last_us: npt.NDArray[np.int64],
) -> None:
    """Add N events in time order to ``level`` (H, W): it decays with ``tau_us`` and steps by +1 or -1 per event.

    level and last_us (H, W) are changed in place; events outside are skipped.
    """
    height, width = level.shape
    for k in range(len(x)):
        i, j = y[k], x[k]
        if i >= height or j >= width:
            continue
        decay = np.exp(-(t[k] - last_us[i, j]) / tau_us)
        step = 1.0 if p[k] > 0 else -1.0
        level[i, j] = level[i, j] * decay + step
        last_us[i, j] = t[k]
