"""What the events of a DLO should look like, from the straightened strip of its first frame."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.ndimage import gaussian_filter, map_coordinates

from motiondlo.frames.types import Appearance

FloatArray = npt.NDArray[np.float64]
F4 = npt.NDArray[np.float32]

PROFILE_MARGIN_PX = 12.0
"""Reach of a profile beyond the radius: cast shadows and highlights on the board."""
_EDGE_SIGMA_PX = 0.9
_INTERIOR_SHARE = 0.35
_MIN_GRADIENT = 0.02
# Rises of log-luminance across an edge: of one whose sign can be trusted, and of one that surely makes events.
_SURE_SIGN = 0.08
_SURE_EDGE = 0.3


def profile_bins(radius_px: float) -> int:
    """Half the number of half-pixel bins of a profile about its middle."""
    return round(2.0 * (radius_px + PROFILE_MARGIN_PX))


def edge_density(radius_px: float, half_bins: int, rises: FloatArray) -> FloatArray:
    """(S, 2, J) two edges at +-r, summing to one; rises (S, 2): change of log-luminance along the normal at -r, +r.

    Both edges of a DLO are there whatever the light does; a faint one makes fewer events, and either sign of them.
    """
    d = (np.arange(2 * half_bins + 1) - half_bins) * 0.5
    out = np.zeros((len(rises), 2, len(d)))
    for side, place in ((0, -radius_px), (1, radius_px)):
        edge = np.exp(-0.5 * ((d - place) / _EDGE_SIGMA_PX) ** 2)
        weight = 0.15 + np.tanh(np.abs(rises[:, side]) / _SURE_EDGE)
        positive = 0.5 * (1.0 + np.tanh(rises[:, side] / _SURE_SIGN))
        out[:, 0] += (weight * positive)[:, None] * edge
        out[:, 1] += (weight * (1.0 - positive))[:, None] * edge
    return np.asarray(out / out.sum(axis=(1, 2), keepdims=True), dtype=np.float64)


def profile_densities(
    look: Appearance | None, s_px: FloatArray, radius_px: float, half_bins: int, along_px: float
) -> FloatArray:
    """Densities (S, 2, J) of positive and negative brightness gradients along the normal at arc lengths ``s_px`` (S,).

    Each sums to one over both signs. Most of it lies at the two edges at +-r, the rest where the frame has gradients:
    highlights, prints, cast shadows. Without a look, or where the frame does not reach: two edges of either sign.
    """
    unknown = edge_density(radius_px, half_bins, np.zeros((len(s_px), 2)))
    if look is None:
        return unknown
    rows = (s_px - look.s0_px) / look.ds_px
    half = max(1, round(0.5 * along_px / look.ds_px))
    centre = (look.strip.shape[1] - 1) / 2.0
    d: FloatArray = (np.arange(2 * half_bins + 1, dtype=np.float64) - half_bins) * 0.5
    columns = d / look.dn_px + centre
    steps = range(-half, half + 1)
    profile: FloatArray = np.mean([_sample(look.strip, rows + k, columns) for k in steps], axis=0, dtype=np.float64)
    known = np.stack([_sample(look.known.astype(np.float32), rows + k, columns) for k in steps]).mean(axis=(0, 2))
    rises = np.stack([_rise(profile, d, side * radius_px) for side in (-1.0, 1.0)], axis=1)
    gradient = np.gradient(gaussian_filter(profile, (0.0, 1.0), mode="nearest"), 0.5, axis=1)
    strength = np.sqrt(np.maximum(np.abs(gradient) - _MIN_GRADIENT, 0.0))
    total = strength.sum(axis=1)
    inside = np.stack([np.where(gradient > 0.0, strength, 0.0), np.where(gradient < 0.0, strength, 0.0)], axis=1)
    # A plain DLO on a plain board has nothing but noise between its edges.
    share = (_INTERIOR_SHARE * np.minimum(1.0, total / 20.0))[:, None, None]
    mixed = (1.0 - share) * edge_density(radius_px, half_bins, rises)
    mixed += share * inside / np.maximum(total, 1e-9)[:, None, None]
    return np.where((known > 0.7)[:, None, None], mixed, unknown)


def _rise(profile: FloatArray, d: FloatArray, place: float) -> FloatArray:
    """(S,) change of (S, J) profiles across an edge at one offset."""
    across = [np.interp((place - 2.5, place + 2.5), d, row) for row in profile]
    return np.asarray([after - before for before, after in across], dtype=np.float64)


def seen_in_frame(
    look: Appearance | None, s_px: FloatArray, radius_px: float, along_px: float
) -> npt.NDArray[np.bool_]:
    """(S,) whether the frame shows both edges of the DLO at arc lengths ``s_px``: under a plate there are none.

    Without a look everything counts as seen.
    """
    if look is None:
        return np.ones(len(s_px), np.bool_)
    rows = (s_px - look.s0_px) / look.ds_px
    half = max(1, round(0.5 * along_px / look.ds_px))
    d = np.arange(-radius_px - 6.0, radius_px + 6.5)
    columns = d / look.dn_px + (look.strip.shape[1] - 1) / 2.0
    profile = np.stack([_sample(look.strip, rows + k, columns) for k in range(-half, half + 1)]).mean(axis=0)
    gradient = np.abs(np.gradient(gaussian_filter(profile, (0.0, 1.0), mode="nearest"), axis=1))
    sides = [gradient[:, np.abs(d - side * radius_px) <= 3.0].max(axis=1) for side in (-1, 1)]
    strength = np.minimum(*sides)
    usual = np.percentile(strength, 75)
    return np.asarray((strength > 0.35 * usual) & (strength > 0.01), dtype=np.bool_)


@dataclass(frozen=True)
class EndPatch:
    """Brightness gradients about an end of a chain, 1 px apart (see ``patch_kernels``)."""

    grad_a: F4
    """(A, D) along the outward tangent."""
    grad_d: F4
    """(A, D) along the left normal."""
    a0: float
    a1: float
    dm: float
    strength: float
    """Share of the patch's pixels whose gradient would make events."""


def end_patch(
    look: Appearance, end: int, length_px: float, a0: float, a1: float, dm: float, own_radius_px: float = 0.0
) -> EndPatch:
    """The patch from ``a0`` to ``a1`` px outwards of end 0 or 1, +-``dm`` px to the sides.

    own_radius_px: when given, only the DLO of this radius counts, not what surrounds its tip.
    """
    a = np.arange(a0, a1 + 0.5)
    d = np.arange(-dm, dm + 0.5)
    s = length_px + a if end == 1 else -a
    rows = (s - look.s0_px) / look.ds_px
    columns = d / look.dn_px + (look.strip.shape[1] - 1) / 2.0
    image = gaussian_filter(_sample(look.strip, rows, columns), 0.8, mode="nearest")
    known = _sample(look.known.astype(np.float32), rows, columns) > 0.9
    if own_radius_px > 0.0:
        # Only the DLO itself moves with its tip: the board's marks beyond it stay where they are.
        known &= (a[:, None] < 5.0) & (np.abs(d)[None] < own_radius_px + 3.0)
    grad_a = np.where(known, np.gradient(image, axis=0), 0.0)
    grad_d = np.where(known, np.gradient(image, axis=1), 0.0)
    strength = float((np.hypot(grad_a, grad_d) > 0.05).mean())
    return EndPatch(
        np.ascontiguousarray(grad_a, dtype=np.float32),
        np.ascontiguousarray(grad_d, dtype=np.float32),
        float(a[0]),
        float(a[-1]),
        float(d[-1]),
        strength,
    )


def _sample(image: F4, rows: FloatArray, columns: FloatArray) -> FloatArray:
    """(len(rows), len(columns)) linear interpolation, borders repeated."""
    grid = np.meshgrid(rows, columns, indexing="ij")
    return np.asarray(map_coordinates(image, grid, order=1, mode="nearest", output=np.float64), dtype=np.float64)
