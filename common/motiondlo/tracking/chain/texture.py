"""Prints and texture on a DLO: small patches whose shift along the tangent says where the material is."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.ndimage import gaussian_filter, map_coordinates

from motiondlo.frames.types import Appearance
from motiondlo.tracking.chain import patch_kernels

FloatArray = npt.NDArray[np.float64]
F4 = npt.NDArray[np.float32]

PAD_PX = 12
DIRECTIONS = 8

_HALF_LENGTH_PX = 16
_WIDTH_SHARE = 0.75
_MIN_STRENGTH = 0.012
"""Mean gradient of log-luminance along the DLO, per px, of a patch that makes enough events of its own."""


@dataclass(frozen=True)
class Texture:
    """N patches on a DLO, strongest first."""

    s_px: FloatArray
    """(N,) arc lengths of their middles."""
    tables: F4
    """(N, DIRECTIONS, 2, A, D) log-likelihood ratios with a rim of ``PAD_PX`` (see ``patch_kernels.build_table``)."""
    half_length_px: float
    half_width_px: float


def find_texture(look: Appearance | None, length_px: float, radius_px: float, most: int) -> Texture | None:
    """Patches with contrast along the DLO; None when it has none."""
    half_width = int(_WIDTH_SHARE * radius_px)
    rim = _HALF_LENGTH_PX + radius_px
    if look is None or most == 0 or half_width < 3 or length_px < 2.0 * rim + 8.0:
        return None
    s = np.arange(0.0, length_px)
    d = np.arange(-half_width, half_width + 0.5)
    rows, columns = (s - look.s0_px) / look.ds_px, d / look.dn_px + (look.strip.shape[1] - 1) / 2.0
    grid = np.meshgrid(rows, columns, indexing="ij")
    image = gaussian_filter(map_coordinates(look.strip, grid, order=1, mode="nearest", output=np.float64), 0.8)
    known = map_coordinates(look.known.astype(np.float64), grid, order=1, mode="nearest").min(axis=1) > 0.9
    along, across = np.gradient(image, axis=0), np.gradient(image, axis=1)
    # Shading along the DLO is no mark: only what changes within a few pixels is.
    strength = np.where(known, np.maximum(np.abs(along) - 0.015, 0.0).mean(axis=1), 0.0)
    strength = np.convolve(strength, np.full(2 * _HALF_LENGTH_PX + 1, 1.0 / (2 * _HALF_LENGTH_PX + 1)), "same")
    strength[: int(rim)] = 0.0
    strength[len(strength) - int(rim) :] = 0.0
    chosen: list[int] = []
    for k in np.argsort(-strength, kind="stable"):
        if strength[k] < _MIN_STRENGTH or len(chosen) >= most:
            break
        if all(abs(int(k) - c) >= 1.5 * _HALF_LENGTH_PX for c in chosen):
            chosen.append(int(k))
    if not chosen:
        return None
    rows_out, columns_out = 2 * _HALF_LENGTH_PX + 1, 2 * half_width + 1
    tables = np.zeros((len(chosen), DIRECTIONS, 2, rows_out + 2 * PAD_PX, columns_out + 2 * PAD_PX), np.float32)
    density = np.zeros((2, rows_out, columns_out), np.float32)
    for i, k in enumerate(chosen):
        part = slice(k - _HALF_LENGTH_PX, k + _HALF_LENGTH_PX + 1)
        grad_a = np.ascontiguousarray(along[part], dtype=np.float32)
        grad_d = np.ascontiguousarray(across[part], dtype=np.float32)
        for j in range(DIRECTIONS):
            angle = 2.0 * np.pi * j / DIRECTIONS
            patch_kernels.build_table(
                grad_a, grad_d, float(np.cos(angle)), float(np.sin(angle)), PAD_PX, density, tables[i, j]
            )
    return Texture(np.array(chosen, dtype=np.float64), tables, float(_HALF_LENGTH_PX), float(half_width))
