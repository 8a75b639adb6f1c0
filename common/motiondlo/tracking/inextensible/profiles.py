"""Signed edge profiles of stations from the look of a DLO in a frame.

A profile is the density of motion-compensated events over the offset ``d`` along the normal (bins of half a pixel), in
two rows: where luminance rises along the normal, and where it falls. Both silhouettes lie at plus and minus the radius
whatever the light does; their signs, and what lies between and beyond (highlights, prints, the cast shadow), come from
the frame's straightened strip.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from motiondlo.frames.types import Appearance, FloatArray
from motiondlo.tracking.inextensible.observe_kernels import BINS_PER_PX
from motiondlo.tracking.inextensible.params import InextensibleParams

Float32Array = npt.NDArray[np.float32]
_SEARCH_PX = 4.0


def profile_bins(radius_px: float, reach_px: float) -> int:
    """How many half-pixel bins a profile has: odd, symmetric about the centreline."""
    return 2 * int(np.ceil((radius_px + reach_px) * BINS_PER_PX)) + 1


def prior_profiles(
    s_px: FloatArray, radius_px: float, appearance: Appearance | None, params: InextensibleParams
) -> Float32Array:
    """Profiles (m, 2, bins) float32 at material coordinates ``s_px`` (m,); each sums to 1.

    Without an appearance both signs are equally likely at both silhouettes.
    """
    bins = profile_bins(radius_px, params.profile_reach_px)
    d = (np.arange(bins) - (bins - 1) / 2) / BINS_PER_PX
    at = (-radius_px, radius_px) if appearance is None else silhouettes(s_px, radius_px, appearance)
    edges = np.stack([np.exp(-0.5 * ((d - edge) / params.edge_width_px) ** 2) for edge in at])
    edges /= edges.sum(axis=1, keepdims=True)
    profiles = np.zeros((len(s_px), 2, bins))
    if appearance is None:
        profiles[:] = 0.25 * edges.sum(axis=0)
        return np.asarray(profiles, dtype=np.float32)
    gradient, rise = _strip_gradient(s_px, d, at, appearance)
    visible_rise = np.tanh(np.abs(rise) / params.contrast_scale)
    for side in range(2):
        positive = 0.5 * (1.0 + np.tanh(rise[:, side] / params.contrast_sign))
        weight = 0.15 + visible_rise[:, side]
        profiles[:, 0] += (weight * positive)[:, None] * edges[side]
        profiles[:, 1] += (weight * (1.0 - positive))[:, None] * edges[side]
    inner = np.stack([np.maximum(gradient, 0.0), np.maximum(-gradient, 0.0)], axis=1)
    inner = np.sqrt(np.maximum(inner - params.gradient_floor, 0.0))
    total = np.maximum(inner.sum(axis=(1, 2)), 1e-6)
    # A board without texture and a matt DLO give nothing but noise between the silhouettes: do not blow it up.
    share = params.interior_share * np.minimum(1.0, total / 10.0)
    profiles *= ((1.0 - share) / profiles.sum(axis=(1, 2)))[:, None, None]
    profiles += (share / total)[:, None, None] * inner
    return np.asarray(profiles / profiles.sum(axis=(1, 2), keepdims=True), dtype=np.float32)


def _rows_near(s_px: FloatArray, appearance: Appearance) -> FloatArray:
    """Log-luminance across the DLO (m, columns) at ``s_px`` (m,), averaged over 12 px along it."""
    strip = appearance.strip.astype(np.float64)
    rows = len(strip)
    half = max(1, round(6.0 / appearance.ds_px))
    row = np.clip(np.round((s_px - appearance.s0_px) / appearance.ds_px).astype(int), 0, rows - 1)
    return np.asarray(strip[np.clip(row[:, None] + np.arange(-half, half + 1), 0, rows - 1)].mean(axis=1))


def _across(near: FloatArray, at: FloatArray, dn_px: float) -> FloatArray:
    """Columns of ``near`` (m, columns) at offsets ``at`` (k,) px from the middle: (m, k)."""
    columns = near.shape[1]
    u = np.clip(at / dn_px + (columns - 1) / 2, 0.0, columns - 1.0)
    left = np.minimum(u.astype(int), columns - 2)
    share = u - left
    return np.asarray(near[:, left] * (1.0 - share) + near[:, left + 1] * share)


def silhouettes(s_px: FloatArray, radius_px: float, appearance: Appearance) -> tuple[float, float]:
    """Offsets of both silhouettes: plus and minus the radius, unless the strip contradicts it.

    The frame's diameter may miss the dark rim of a DLO, and the rim's inner edge has the wrong sign: then a silhouette
    lies where the strip changes most.
    """
    near, dn = _rows_near(s_px, appearance), appearance.dn_px
    found = []
    for side in (-1.0, 1.0):
        edge = side * radius_px
        at = edge + np.arange(-_SEARCH_PX, _SEARCH_PX + 0.25, 0.25)
        # Of all stations, so that a print on some of them does not count.
        step = np.median(_across(near, at + 1.0, dn) - _across(near, at - 1.0, dn), axis=0)
        rise = np.median(_across(near, np.array([edge + 2.5]), dn) - _across(near, np.array([edge - 2.5]), dn))
        k = int(np.abs(step).argmax())
        found.append(float(at[k]) if step[k] * rise < 0.0 and 0 < k < len(at) - 1 else edge)
    return found[0], found[1]


def _strip_gradient(
    s_px: FloatArray, d: FloatArray, edges_px: tuple[float, float], appearance: Appearance
) -> tuple[FloatArray, FloatArray]:
    """Gradient of log-luminance along the normal (m, bins) per px, and its rise across either silhouette (m, 2)."""
    near, dn = _rows_near(s_px, appearance), appearance.dn_px
    gradient = _across(near, d + 0.5, dn) - _across(near, d - 0.5, dn)
    at = np.array(edges_px)
    return gradient, _across(near, at + 2.5, dn) - _across(near, at - 2.5, dn)


def visible_at_start(s_px: FloatArray, radius_px: float, appearance: Appearance | None) -> npt.NDArray[np.bool_]:
    """(m,) whether the silhouettes are to be seen in the frame at ``s_px``: what is covered there is not at rest."""
    if appearance is None:
        return np.ones(len(s_px), dtype=bool)
    _, rise = _strip_gradient(s_px, np.zeros(1), (-radius_px, radius_px), appearance)
    strength = np.abs(rise).sum(axis=1)
    return np.asarray(strength > 0.35 * np.median(strength))


def log_ratios(profiles: Float32Array, floor: float) -> Float32Array:
    """Log-likelihood ratios against a uniform density; ``floor`` is added to both. Same shape, float32."""
    bins = profiles.shape[2]
    return np.asarray(np.log((profiles + floor) / (0.5 / bins + floor)), dtype=np.float32)
