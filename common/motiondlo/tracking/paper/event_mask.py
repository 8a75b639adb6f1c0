"""Binary mask of the moving DLO from the time surfaces (paper, "Event Branch: Dynamic DLO")."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from motiondlo.events.types import SensorGeometry
from motiondlo.tracking.paper.mask_kernels import newest_age_of_cells
from motiondlo.tracking.paper.morphology import Mask, close_mask, drop_small_parts, morphology_scale, open_mask
from motiondlo.tracking.paper.params import PaperParams
from motiondlo.tracking.paper.recentness import AGE_BINS, active_age_us, oldest_age_us, recentness_threshold
from motiondlo.tracking.paper.region import Region

# Parts smaller than this are artefacts, whatever their shape: after closing in squared diameters, before it (a piece of
# an edge, one cell wide) in diameters.
_SMALLEST_PART_DIAMETERS2 = 0.25
_SMALLEST_EDGE_DIAMETERS = 0.5


def active_cells(
    last_us: npt.NDArray[np.int64],
    region: Region,
    now_us: int,
    tau_us: float,
    diameter_px: float,
    params: PaperParams,
    longest_us: npt.NDArray[np.float64] | None = None,
) -> Mask:
    """Threshold the recentness of the region's cells and remove small artefacts.

    last_us: (2, H, W) int64, newest event per polarity and pixel. longest_us: (M - 1,) limit of the age near each
    segment of the region's curve, or None for none. Returns (h, w) uint8 0/1.
    """
    ages_us = np.empty(region.inside.shape, np.int32)
    counts = np.zeros(AGE_BINS, np.int64)
    oldest_us = int(active_age_us(tau_us))
    newest_age_of_cells(
        last_us, region.inside, region.x0_px, region.y0_px, region.cell_px, now_us, oldest_us, ages_us, counts
    )
    threshold = recentness_threshold(counts, tau_us, params.recentness_min, params.recentness_max)
    limit_us: float | npt.NDArray[np.float64] = min(oldest_age_us(threshold, tau_us), oldest_us)
    if longest_us is not None:
        limits_us = np.minimum(longest_us, limit_us)
        limit_us = limits_us[np.clip(region.inside.astype(np.int64) - 1, 0, len(limits_us) - 1)]
    mask = np.asarray(ages_us < limit_us, dtype=np.uint8)
    # Noise that closing would join to the DLO goes first ("remove small artifacts and bridge short discontinuities").
    return drop_small_parts(mask, _SMALLEST_EDGE_DIAMETERS * diameter_px / region.cell_px)


def active_ratio(active: Mask, region: Region, geometry: SensorGeometry) -> float:
    """rho: the share of the sensor's pixels that are active, before closing (bridged gaps are no activity)."""
    return float(active.sum()) * region.cell_px**2 / (geometry.width_px * geometry.height_px)


def refined(active: Mask, region: Region, diameter_px: float, params: PaperParams) -> Mask:
    """The mask M: closed and opened by the DLO's diameter, within the region. (h, w) uint8 0/1."""
    scale = morphology_scale(params, diameter_px, region.cell_px)
    mask = close_mask(active, scale.close_cells)
    mask[region.inside == 0] = 0
    mask = open_mask(mask, scale.open_cells)
    return drop_small_parts(mask, _SMALLEST_PART_DIAMETERS2 * (diameter_px / region.cell_px) ** 2)
