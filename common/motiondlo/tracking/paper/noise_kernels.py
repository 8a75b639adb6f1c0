"""Kernel of the spatio-temporal noise filter."""

from __future__ import annotations

import numba
import numpy as np
import numpy.typing as npt


@numba.njit(cache=True, nogil=True)
def keep_corroborated(
    t_us: npt.NDArray[np.int64],
    x: npt.NDArray[np.uint16],
    y: npt.NDArray[np.uint16],
    last_us: npt.NDArray[np.int64],
    radius_px: int,
    window_us: int,
    hot_pixel_period_us: int,
    keep: npt.NDArray[np.uint8],
) -> int:
    """Mark events that a neighbour within ``radius_px`` preceded by at most ``window_us``.

    t_us, x, y: (N,) in time order. last_us: (H, W) newest time of each pixel, any polarity; updated by every event,
    kept or not, so that two real events support each other whichever comes first. A pixel's own history is no support
    (that is what a hot pixel has), and repeats faster than ``hot_pixel_period_us`` are dropped. Events outside the
    sensor are dropped. keep: (N,) uint8, written. Returns the number of events kept.
    """
    height, width = last_us.shape
    kept = 0
    for i in range(t_us.shape[0]):
        px = int(x[i])
        py = int(y[i])
        keep[i] = 0
        if px >= width or py >= height:
            continue
        t = t_us[i]
        own = last_us[py, px]
        last_us[py, px] = t
        if t - own < hot_pixel_period_us:
            continue
        oldest = t - window_us
        supported = False
        y_from, y_to = max(py - radius_px, 0), min(py + radius_px + 1, height)
        x_from, x_to = max(px - radius_px, 0), min(px + radius_px + 1, width)
        for yy in range(y_from, y_to):
            for xx in range(x_from, x_to):
                if (yy != py or xx != px) and last_us[yy, xx] >= oldest:
                    supported = True
                    break
            if supported:
                break
        if supported:
            keep[i] = 1
            kept += 1
    return kept
