"""PCA-based centreline of the event mask (paper, "Event Branch: Dynamic DLO").

"A PCA-based centerline is first computed, as it remains robust under local gaps caused by vibration nodes and regions
that temporarily produce no events." It is single-valued along the principal axis: where a DLO turns by more than about
90 degrees it cannot follow, and the skeleton path has to.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from scipy.ndimage import gaussian_filter1d

from motiondlo.tracking.paper.morphology import Mask

FloatArray = npt.NDArray[np.float64]

_FEWEST_CELLS = 20
_MOST_CELLS = 4000
_SMOOTHING_BINS = 2.0


def pca_centreline(mask: Mask, bins: int) -> FloatArray | None:
    """Median across the principal axis in ``bins`` bins of equally many cells, ordered along the axis.

    mask: (h, w) uint8 0/1. Returns (bins', 2) float64 cell coordinates (column, row), from the first to the last cell
    along the axis; None for fewer than 20 cells or a mask without extent.
    """
    row, column = np.nonzero(mask)
    if len(row) < _FEWEST_CELLS:
        return None
    if len(row) > _MOST_CELLS:
        every = np.linspace(0, len(row) - 1, _MOST_CELLS).astype(np.int64)
        row, column = row[every], column[every]
    points = np.stack([column, row], axis=1).astype(np.float64)
    mean = points.mean(axis=0)
    _, axes = np.linalg.eigh(np.cov((points - mean).T))
    along, across = (points - mean) @ axes[:, 1], (points - mean) @ axes[:, 0]
    if np.ptp(along) < 2.0:
        return None
    order = np.argsort(along, kind="stable")
    parts = np.array_split(order, min(bins, len(order) // 5))
    t = np.array([along[part].mean() for part in parts])
    n = np.array([np.median(across[part]) for part in parts])
    if len(t) < 4:
        return None
    t[0], t[-1] = along[order[0]], along[order[-1]]
    n = gaussian_filter1d(n, _SMOOTHING_BINS, mode="nearest")
    return np.asarray(mean + t[:, None] * axes[:, 1] + n[:, None] * axes[:, 0], dtype=np.float64)
