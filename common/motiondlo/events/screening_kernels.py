"""Kernels of the screening: events per tile, background, regions, flicker, hot pixels.

Legend: tiles, ``packed`` and the words in ``rings`` are those of :mod:`motiondlo.events.bucket_kernels`. ``masked``
(H, W) uint8, or (0, 0) for none: bit 0 a region, bit 1 a hot pixel. R, C: rows and columns of tiles.
"""

from __future__ import annotations

import numba
import numpy as np

from motiondlo.events.bucket_kernels import COORDINATE_MASK, TILE_SHIFT, TIME_SHIFT, X_SHIFT, Y_MASK, Y_SHIFT

REGION, HOT = 1, 2
_POLARITY = np.int64(1 << 32)
TILE_PX2 = float(1 << (2 * TILE_SHIFT))
LEVELS = 256
NEW_BURST = 0.35
"""Events of a pixel and polarity within this share of a period belong to one burst."""


@numba.njit(cache=True, nogil=True)
def count_tiles(packed, masked, width, height, both, counts, ups):  # type: ignore[no-untyped-def]
    """Count events per tile, all in counts (R, C) int32 and those of polarity 1 in ups (R, C) int32.

    both: (R, C) int64 scratch, all zero and left so: an event costs one addition.
    """
    masking = masked.shape[0] > 0
    for i in range(packed.shape[0]):
        place = packed[i, 1]
        x = place & 0xFFFF
        y = (place >> 16) & 0xFFFF
        if x >= width or y >= height or (masking and masked[y, x]):
            continue
        both[y >> TILE_SHIFT, x >> TILE_SHIFT] += 1 + (place & _POLARITY)
    for r in range(both.shape[0]):
        for c in range(both.shape[1]):
            counts[r, c] = both[r, c] & 0xFFFFFFFF
            ups[r, c] = both[r, c] >> 32
            both[r, c] = 0


@numba.njit(cache=True, nogil=True)
def share_above(counts, least):  # type: ignore[no-untyped-def]
    """Share of the tiles that have at least ``least`` events."""
    n = 0
    for r in range(counts.shape[0]):
        for c in range(counts.shape[1]):
            n += counts[r, c] >= least
    return n / counts.size


@numba.njit(cache=True, nogil=True)
def free_median(counts, tiles):  # type: ignore[no-untyped-def]
    """Median count of the tiles that no DLO touches. tiles: (R, C) uint32, not 0 where one does."""
    histogram = np.zeros(LEVELS, np.int64)
    free = 0
    for r in range(counts.shape[0]):
        for c in range(counts.shape[1]):
            if tiles[r, c] == 0:
                histogram[min(counts[r, c], LEVELS - 1)] += 1
                free += 1
    below = 0
    for level in range(LEVELS):
        below += histogram[level]
        if 2 * below > free:
            return level
    return 0


@numba.njit(cache=True, nogil=True)
def learn_tiles(counts, tiles, moving_bits, share, span_ms, busy_count, busy, rate):  # type: ignore[no-untyped-def]
    """Follow how often and how much each tile fires while no moving DLO touches it.

    tiles: (R, C) uint32 bits of the DLOs, ``moving_bits`` those that move. busy, rate: (R, C) float32, the share of
    time with at least ``busy_count`` events a batch and the mean events/px/ms; ``share`` of the news is taken up.
    """
    scale = 1.0 / (TILE_PX2 * span_ms)
    for r in range(counts.shape[0]):
        for c in range(counts.shape[1]):
            if tiles[r, c] & moving_bits:
                continue
            fires = 1.0 if counts[r, c] >= busy_count else 0.0
            busy[r, c] += share * (fires - busy[r, c])
            rate[r, c] += share * (counts[r, c] * scale - rate[r, c])


@numba.njit(cache=True, nogil=True)
def write_background(everywhere, busy, rate, busy_share, most, background):  # type: ignore[no-untyped-def]
    """Background per tile: what lies everywhere, or was learned there if it is more. Returns how many are learned.

    everywhere, most (that is taken over from there): events/px/ms; background: (R * C,) float32 out, events/px/ms.
    """
    rows, columns = busy.shape
    learned = 0
    for r in range(rows):
        for c in range(columns):
            value = everywhere
            if busy[r, c] > busy_share:
                learned += 1
                value = max(value, min(rate[r, c], most))
            background[r * columns + c] = value
    return learned


@numba.njit(cache=True, nogil=True)
def file_screened(  # type: ignore[no-untyped-def]
    packed, width, height, rings, heads, columns, masked, flicker, bursts, period_us, tolerance
):
    """As :func:`motiondlo.events.bucket_kernels.file_events`, without what is masked or flickers.

    flicker: (R, C) uint8, 1 where a lamp flickers with ``period_us``; bursts: (2, H, W) int64, or (0, 0, 0) for no
    flicker anywhere: when a pixel's last burst of a polarity began, times 2, plus 1 if it was taken for flicker. A
    burst is flicker if the one before it began a period ago, give or take ``tolerance`` of it.
    Returns (events outside the sensor, masked, taken for flicker).
    """
    ring_mask = rings.shape[1] - 1
    masking = masked.shape[0] > 0
    flickering = bursts.shape[0] > 0
    outside = 0
    hidden = 0
    suppressed = 0
    same_us = np.int64(NEW_BURST * period_us)
    early_us = np.int64((1.0 - tolerance) * period_us)
    late_us = np.int64((1.0 + tolerance) * period_us)
    for i in range(packed.shape[0]):
        place = packed[i, 1]
        x = place & 0xFFFF
        y = (place >> 16) & 0xFFFF
        if x >= width or y >= height:
            outside += 1
            continue
        if masking and masked[y, x]:
            hidden += 1
            continue
        p = (place >> 32) & 1
        t = packed[i, 0]
        if flickering and flicker[y >> TILE_SHIFT, x >> TILE_SHIFT]:
            gap = t - (bursts[p, y, x] >> 1)
            if gap >= same_us:
                bursts[p, y, x] = (t << 1) | np.int64(early_us <= gap <= late_us)
            if bursts[p, y, x] & 1:
                suppressed += 1
                continue
        tile = (y >> TILE_SHIFT) * columns + (x >> TILE_SHIFT)
        head = heads[tile]
        rings[tile, head & ring_mask] = (t << TIME_SHIFT) | (y << Y_SHIFT) | (x << X_SHIFT) | p
        heads[tile] = head + 1
    return outside, hidden, suppressed


@numba.njit(cache=True, nogil=True)
def signed_blocks(counts, ups, size, signed, total):  # type: ignore[no-untyped-def]
    """Sum over ``size`` x ``size`` tiles: ON minus OFF in signed, all events in total, both (A, B) float32."""
    signed[:, :] = 0.0
    total[:, :] = 0.0
    for r in range(counts.shape[0]):
        for c in range(counts.shape[1]):
            n = counts[r, c]
            if n:
                signed[r // size, c // size] += 2 * ups[r, c] - n
                total[r // size, c // size] += n


@numba.njit(cache=True, nogil=True)
def find_periods(times_us, signed, total, frequencies_hz, least, share, found_hz):  # type: ignore[no-untyped-def]
    """The frequency at which the signed event rate of a block alternates; 0 where it does not.

    times_us: (T,); signed, total: (T, A, B) per batch; a block with fewer than ``least`` events is not judged, and one
    sine must explain at least ``share`` of its power. found_hz: (A, B) float64 out.
    """
    n = times_us.shape[0]
    found_hz[:, :] = 0.0
    wave = np.empty((frequencies_hz.shape[0], 2, n))
    for f in range(frequencies_hz.shape[0]):
        for k in range(n):
            angle = 2e-6 * np.pi * frequencies_hz[f] * (times_us[k] - times_us[0])
            wave[f, 0, k] = np.cos(angle)
            wave[f, 1, k] = np.sin(angle)
    for a in range(found_hz.shape[0]):
        for b in range(found_hz.shape[1]):
            events = 0.0
            mean = 0.0
            for k in range(n):
                events += total[k, a, b]
                mean += signed[k, a, b]
            if events < least:
                continue
            mean /= n
            power = 0.0
            for k in range(n):
                power += (signed[k, a, b] - mean) ** 2
            best = share * power
            for f in range(frequencies_hz.shape[0]):
                real = 0.0
                imaginary = 0.0
                for k in range(n):
                    value = signed[k, a, b] - mean
                    real += value * wave[f, 0, k]
                    imaginary += value * wave[f, 1, k]
                explained = 2.0 / n * (real * real + imaginary * imaginary)
                if explained > best:
                    best = explained
                    found_hz[a, b] = frequencies_hz[f]


@numba.njit(cache=True, nogil=True)
def judge_tile(ring, head, since_us, now_us, least_hz, ratio, least, score, found):  # type: ignore[no-untyped-def]
    """Pixels of one tile that fire far more than their neighbours, from the events that its ring still has.

    ring: (capacity,) words. least: fewest events. score: (256,) uint16 scratch. found: (K,) int64 out, ``y << 11 | x``.
    Returns how many.
    """
    size = ring.shape[0]
    score[:] = 0
    oldest_us = now_us
    for k in range(head - 1, max(head - size, 0) - 1, -1):
        word = ring[k & (size - 1)]
        t_us = word >> TIME_SHIFT
        if t_us < since_us:
            oldest_us = since_us
            break
        oldest_us = min(oldest_us, t_us)
        x = (word >> X_SHIFT) & 15
        y = (word >> Y_SHIFT) & 15
        score[y * 16 + x] += 1
    if head <= size:
        oldest_us = since_us
    fewest = max(float(least), least_hz * (now_us - oldest_us) * 1e-6)
    n = 0
    for y in range(16):
        for x in range(16):
            count = score[y * 16 + x]
            if count < fewest:
                continue
            around = 0
            total = 0
            for v in range(max(y - 1, 0), min(y + 2, 16)):
                for u in range(max(x - 1, 0), min(x + 2, 16)):
                    around += 1
                    total += score[v * 16 + u]
            around -= 1
            total -= count
            if count * around > ratio * (around + total) and n < found.shape[0]:
                word = ring[(head - 1) & (size - 1)]
                x0 = ((word >> X_SHIFT) & COORDINATE_MASK) & ~15
                y0 = ((word >> Y_SHIFT) & Y_MASK) & ~15
                found[n] = ((y0 + y) << 11) | (x0 + x)
                n += 1
    return n
