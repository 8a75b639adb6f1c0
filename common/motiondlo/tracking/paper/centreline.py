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
_MOST_CELLS = 2000
_SMOOTHING_BINS = 2.0


def pca_centreline(mask: Mask, bins: int) -> FloatArray | None:
    """Median across the principal axis in ``bins`` bins of equally many cells, ordered along the axis.

    mask: (h, w) uint8 0/1. Returns (K, 2) float64 cell coordinates (column, row), from the first to the last cell
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
    centred = points - mean
    _, axes = np.linalg.eigh(centred.T @ centred)
    along, across = centred @ axes[:, 1], centred @ axes[:, 0]
    if np.ptp(along) < 2.0:
        return None
    order = np.argsort(along)
    each = max(len(order) // bins, 5)
    full = order[: len(order) // each * each].reshape(-1, each)
    if len(full) < 4:
        return None
    t = along[full].mean(axis=1)
    n = gaussian_filter1d(np.median(across[full], axis=1), _SMOOTHING_BINS, mode="nearest")
    t[0], t[-1] = along[order[0]], along[order[-1]]
    return np.asarray(mean + t[:, None] * axes[:, 1] + n[:, None] * axes[:, 0], dtype=np.float64)
