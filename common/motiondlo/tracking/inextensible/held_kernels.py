"""How far a held DLO is seen to go on into what holds it: both silhouettes along its last centimetres.

The frame branch ends a held DLO where the jaws begin in the RGB picture; they stand higher than the DLO, so that the
event camera sees them elsewhere. Where both silhouettes make their events, the DLO is there.
"""

from __future__ import annotations

import numba
import numpy as np

from motiondlo.events.bucket_kernels import note_times
from motiondlo.tracking.inextensible.observe_kernels import BINS_PER_PX

STEP_PX = 2.0
BEYOND_PX = 40.0
INWARD_PX = 64.0
PLACES = int((BEYOND_PX + INWARD_PX) / STEP_PX) + 1
NOT_SEEN_PX = 1e9
_LEVEL_FROM_PX = 24.0
_SIGNS_FROM_PX = 40.0
_LEAST_LEVEL = 0.2
_STEP_PLACES = 4
MOST_TRAVEL_PX = 3.0
"""Events are looked at while the silhouette went so far, so that a ring still has them."""


@numba.njit(cache=True, nogil=True, fastmath=True)
def silhouette_signs(profile, station, radius_px):  # type: ignore[no-untyped-def]
    """(at -radius, at +radius): 1 where luminance rises along the normal, else 0.

    profile: (m, 2, bins); station: which, a real number.
    """
    i = min(max(int(np.ceil(station - 0.5)), 0), profile.shape[0] - 1)
    middle = (profile.shape[2] - 1) // 2
    reach = int(np.rint(radius_px * BINS_PER_PX))
    below = 0.0
    above = 0.0
    for k in range(-2, 3):
        below += profile[i, 0, middle - reach + k] - profile[i, 1, middle - reach + k]
        above += profile[i, 0, middle + reach + k] - profile[i, 1, middle + reach + k]
    return 1 if below >= 0.0 else 0, 1 if above >= 0.0 else 0


@numba.njit(cache=True, nogil=True, fastmath=True)
def note_recent(  # type: ignore[no-untyped-def]
    rings, heads, columns, last_us, t_us, s_end_px, inward, s_lo_px, ds_px, stride, points, vn, beside_px,
    window_max_ms, v_min, places,
):  # fmt: skip
    """Note the times of the events that any of the places may look at, within beside_px of them."""
    m = vn.shape[0]
    samples = points.shape[0]
    x0, y0, x1, y1 = 1e9, 1e9, -1e9, -1e9
    slowest = 1e9
    for k in range(places):
        u = (s_end_px + inward * (k * STEP_PX - BEYOND_PX) - s_lo_px) / ds_px
        i = min(max(int(np.floor(u)), 0), samples - 2)
        q = min(max(u / stride, 0.0), m - 1.0)
        a = min(int(q), m - 2)
        v = abs(vn[a] + (q - a) * (vn[a + 1] - vn[a]))
        if v < v_min:
            continue
        slowest = min(slowest, v)
        x = points[i, 0] + (u - i) * (points[i + 1, 0] - points[i, 0])
        y = points[i, 1] + (u - i) * (points[i + 1, 1] - points[i, 1])
        x0, y0, x1, y1 = min(x0, x), min(y0, y), max(x1, x), max(y1, y)
    if x1 >= x0:
        since_us = t_us - min(window_max_ms, MOST_TRAVEL_PX / slowest) * 1000.0 - 1.0
        beside = beside_px + 1.0
        note_times(rings, heads, columns, last_us, since_us, x0 - beside, y0 - beside, x1 + beside, y1 + beside)


@numba.njit(cache=True, nogil=True, fastmath=True)
def accumulate_presence(  # type: ignore[no-untyped-def]
    rings, heads, columns, last_us, t_us, s_end_px, inward, s_lo_px, ds_px, stride, points, theta, vn, radius_px,
    profile, window_max_ms, latency_ms, v_min, reach_px, rate, presence, looks,
):  # fmt: skip
    """Let ``presence`` (2, PLACES) follow the events at either silhouette, from BEYOND_PX outward to INWARD_PX inward.

    rings to last_us: the event buckets. inward: 1 where the DLO lies towards larger s, else -1; profile: (m, 2, bins),
    which says whether luminance rises or falls along the normal at either silhouette; an event within reach_px of a
    silhouette belongs to it. looks (PLACES,) counts the looks at every place; those that move slower than v_min px/ms
    across are left as they are.
    """
    height, width = last_us.shape[1], last_us.shape[2]
    samples = points.shape[0]
    note_recent(
        rings, heads, columns, last_us, t_us, s_end_px, inward, s_lo_px, ds_px, stride, points, vn,
        radius_px + reach_px + MOST_TRAVEL_PX, window_max_ms, v_min, presence.shape[1],
    )  # fmt: skip
    m = vn.shape[0]
    rising = silhouette_signs(profile, (s_end_px + inward * _SIGNS_FROM_PX - s_lo_px) / (ds_px * stride), radius_px)
    for k in range(presence.shape[1]):
        s = s_end_px + inward * (k * STEP_PX - BEYOND_PX)
        u = (s - s_lo_px) / ds_px
        i = min(max(int(np.floor(u)), 0), samples - 2)
        f = u - i
        px = points[i, 0] + f * (points[i + 1, 0] - points[i, 0])
        py = points[i, 1] + f * (points[i + 1, 1] - points[i, 1])
        g = min(max(f, 0.0), 1.0)
        angle = theta[i] + g * (theta[i + 1] - theta[i])
        nx, ny = -np.sin(angle), np.cos(angle)
        q = min(max(u / stride, 0.0), m - 1.0)
        a = min(int(q), m - 2)
        v = vn[a] + (q - a) * (vn[a + 1] - vn[a])
        inside = 4.0 < px < width - 4.0 and 4.0 < py < height - 4.0
        if abs(v) < v_min or not inside:
            continue
        looks[k] += 1
        weight = max(rate, 1.0 / looks[k])
        window_ms = min(window_max_ms, MOST_TRAVEL_PX / abs(v))
        t_min = t_us - window_ms * 1000.0
        positive = v >= 0.0
        back = v * window_ms
        steps = int(2.0 * reach_px + abs(back)) + 1
        for side in range(2):
            edge = -radius_px if side == 0 else radius_px
            lo = edge - reach_px - max(back, 0.0)
            # Where luminance rises along the normal, motion along it makes OFF events.
            p = 0 if (rising[side] == 1) == positive else 1
            found = 0
            for b in range(steps):
                x = int(px + (lo + b) * nx + 0.5)
                y = int(py + (lo + b) * ny + 0.5)
                if x < 0 or y < 0 or x >= width or y >= height:
                    continue
                ts = last_us[p, y, x]
                if ts > t_min:
                    d = (x - px) * nx + (y - py) * ny + v * ((t_us - ts) * 1e-3 + latency_ms)
                    if abs(d - edge) < reach_px:
                        found += 1
            presence[side, k] += weight * (min(found / max(abs(back), 1.0), 1.0) - presence[side, k])


@numba.njit(cache=True, nogil=True, fastmath=True)
def silhouette_ends(presence, share, out):  # type: ignore[no-untyped-def]
    """out (2,): offset from the end, px (negative: outward), at which either silhouette ends; NOT_SEEN_PX for none.

    It goes on while it keeps ``share`` of its level further inward (over three places), and ends at the steepest fall
    near the last such place.
    """
    start = int((BEYOND_PX + _LEVEL_FROM_PX) / STEP_PX)
    for side in range(2):
        seen = presence[side]
        out[side] = NOT_SEEN_PX
        # A few places that are seen are something else that lies there.
        level = min(seen[start:].mean(), np.median(seen[start:]))
        if level < _LEAST_LEVEL:
            continue
        last = start
        gap = 0
        for k in range(start, 0, -1):
            if (seen[k - 1] + seen[k] + seen[k + 1]) / 3.0 >= share * level:
                last = k
                gap = 0
            else:
                gap += 1
                if gap >= 2:
                    break
        end = last
        steepest = 0.0
        for k in range(max(last - 2, _STEP_PLACES), min(last + 4, start) + 1):
            fall = seen[k : k + _STEP_PLACES].mean() - seen[k - _STEP_PLACES : k].mean()
            if fall > steepest:
                steepest = fall
                end = k
        out[side] = (end - 0.5) * STEP_PX - BEYOND_PX
