"""What DLOs tell one another: where their silhouettes are and how many events they make."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from motiondlo.frames.types import FloatArray
from motiondlo.tracking.inextensible.arrays import Float32Array, Int64Array


class Rivals(NamedTuple):
    """Stations of all DLOs, one block of rows per DLO (legend in :mod:`rival_kernels`); (R,) unless it says otherwise.

    ``first`` (blocks + 1,): block b has the rows from first[b] to first[b + 1].
    """

    first: Int64Array
    t_us: Int64Array
    p: FloatArray
    """(R, 2)"""
    cos: FloatArray
    sin: FloatArray
    kappa: FloatArray
    vn: FloatArray
    vt: FloatArray
    omega: FloatArray
    rate: FloatArray
    """Events per px and ms; 0 for a row that claims nothing."""
    half_px: FloatArray
    bins: Int64Array
    profile: Float32Array
    """(R, 2, bins of the widest), its edges as wide as their place is in doubt."""
    near: Int64Array
    """(R,) scratch of whoever looks."""


def no_rivals() -> Rivals:
    """For a DLO that is alone."""
    return make_rivals([], [])


def make_rivals(stations: list[int], bins: list[int]) -> Rivals:
    """Room for DLOs with so many stations and profile bins each; nothing is claimed yet."""
    rows = sum(stations)
    first = np.concatenate([np.zeros(1, np.int64), np.cumsum(stations, dtype=np.int64)])

    def zeros() -> FloatArray:
        return np.zeros(rows)

    def whole() -> npt.NDArray[np.int64]:
        return np.zeros(rows, np.int64)

    return Rivals(
        first, whole(), np.zeros((rows, 2)), zeros(), zeros(), zeros(), zeros(), zeros(), zeros(), zeros(), zeros(),
        whole(), np.zeros((rows, 2, max(bins, default=1)), np.float32), whole(),
    )  # fmt: skip
