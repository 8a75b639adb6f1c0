"""The pixels of an event camera: from log intensities at two instants to events in between.

A first-order photoreceptor follows the log intensity, slower in the dark. An event fires when its output has left the
memorised level by a threshold; then the pixel is dead for a while, and memorises the level at the end of that time.
"""

from __future__ import annotations

import numba
import numpy as np
import numpy.typing as npt

from motiondlo.simulation.raster_kernels import TILE

FloatArray = npt.NDArray[np.float64]
FloatImage = npt.NDArray[np.float32]
IntArray = npt.NDArray[np.int32]
Tiles = npt.NDArray[np.uint8]
UintArray = npt.NDArray[np.uint64]


@numba.njit(cache=True, nogil=True)
def _uniform(state: UintArray) -> float:
    x = state[0]
    x ^= x << np.uint64(13)
    x ^= x >> np.uint64(7)
    x ^= x << np.uint64(17)
    state[0] = x
    return float((x >> np.uint64(40)) / 16777216.0)


@numba.njit(cache=True, nogil=True)
def _normal(state: UintArray) -> float:
    """Sum of uniform numbers: near enough for a jitter."""
    return float((_uniform(state) + _uniform(state) + _uniform(state) + _uniform(state) - 2.0) * 1.7320508)


@numba.njit(cache=True, nogil=True)
def settle(
    image: FloatImage, gain: FloatImage, dark: float, log_now: FloatImage, output: FloatImage, memory: FloatImage
) -> None:
    """Everything at rest at the image (H, W, 1) of linear light times gain (H, W)."""
    for y in range(log_now.shape[0]):
        for x in range(log_now.shape[1]):
            value = np.log(image[y, x, 0] * gain[y, x] + dark)
            log_now[y, x] = value
            output[y, x] = value
            memory[y, x] = value


@numba.njit(cache=True, nogil=True)
def advance_tiles(
    image: FloatImage,
    gain: FloatImage,
    dark: float,
    tiles: Tiles,
    seen_us: FloatArray,
    t_us: float,
    tau_us: float,
    slice_us: float,
    log_now: FloatImage,
    output: FloatImage,
    memory: FloatImage,
    ready_us: FloatArray,
    on: FloatImage,
    off: FloatImage,
    dead_us: FloatImage,
    jitter: FloatImage,
    jitter_sigma: float,
    state: UintArray,
    out_t: FloatArray,
    out_y: IntArray,
    out_x: IntArray,
    out_p: IntArray,
) -> int:
    """Advance the pixels of the marked tiles from the time at which each tile was last seen to ``t_us``.

    seen_us (tiles) float64 is updated. ready_us (H, W) is the end of the dead time, or negative. Returns the number of
    events written.
    """
    count = 0
    for ty in range(tiles.shape[0]):
        for tx in range(tiles.shape[1]):
            if not tiles[ty, tx]:
                continue
            begin = seen_us[ty, tx]
            seen_us[ty, tx] = t_us
            span = t_us - begin
            if span <= 0.0:
                continue
            pieces = max(1, int(np.ceil(span / slice_us)))
            for y in range(ty * TILE, min((ty + 1) * TILE, log_now.shape[0])):
                for x in range(tx * TILE, min((tx + 1) * TILE, log_now.shape[1])):
                    light = image[y, x, 0] * gain[y, x] + dark
                    before, after = log_now[y, x], np.log(light)
                    log_now[y, x] = after
                    if abs(after - before) < 1e-4 and abs(output[y, x] - after) < 1e-3 and ready_us[y, x] < 0.0:
                        continue
                    tau = tau_us * (0.75 + 0.25 / light)
                    slope = (after - before) / span
                    lag = slope * tau
                    settling = output[y, x] - before + lag
                    ta, va = begin, output[y, x]
                    for piece in range(1, pieces + 1):
                        tb = begin + span * piece / pieces
                        vb = before + slope * (tb - begin) - lag + settling * np.exp(-(tb - begin) / tau)
                        at, level = ta, va
                        rate = (vb - va) / (tb - ta)
                        while True:
                            if ready_us[y, x] >= 0.0:
                                if ready_us[y, x] >= tb:
                                    break
                                if ready_us[y, x] > at:
                                    at = ready_us[y, x]
                                    level = va + rate * (at - ta)
                                memory[y, x] = level
                                ready_us[y, x] = -1.0
                            up = on[y, x] + jitter[y, x]
                            down = off[y, x] + jitter[y, x]
                            if vb - memory[y, x] >= up:
                                goal, p = memory[y, x] + up, 1
                            elif memory[y, x] - vb >= down:
                                goal, p = memory[y, x] - down, 0
                            else:
                                break
                            fire = at
                            if rate != 0.0:
                                fire = min(max(ta + (goal - va) / rate, at), tb)
                            if count < out_t.shape[0]:
                                out_t[count] = fire
                                out_y[count] = y
                                out_x[count] = x
                                out_p[count] = p
                                count += 1
                            ready_us[y, x] = fire + dead_us[y, x]
                            jitter[y, x] = jitter_sigma * _normal(state)
                        ta, va = tb, vb
                    output[y, x] = va
    return count
