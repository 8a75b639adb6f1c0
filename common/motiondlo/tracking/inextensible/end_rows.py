"""The rows of measurements of one update, and the pose of an end that some of them depend on."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from motiondlo.frames.types import FloatArray
from motiondlo.tracking.inextensible.arrays import RowArrays
from motiondlo.tracking.inextensible.row_kernels import end_row


class EndPose:
    """An end of the predicted curve and how it depends on the state; filled anew by every update."""

    def __init__(self, n: int) -> None:
        self.place: FloatArray = np.zeros(2)
        """(2,) px."""
        self.outward: FloatArray = np.zeros(2)
        """(2,) unit vector away from the DLO."""
        self.velocity: FloatArray = np.zeros(2)
        """(2,) px/ms."""
        self.omega = 0.0
        """rad/ms."""
        self.jacobian: FloatArray = np.zeros((2, n))
        self.angle_row: FloatArray = np.zeros(n - 2)
        """(K,) d theta / d c."""
        self.acceleration = 0.0
        """|px/ms^2| lately."""


@dataclass
class Rows:
    """Preallocated measurement rows; ``count`` of them are filled."""

    h: FloatArray
    z: FloatArray
    w: FloatArray
    robust: npt.NDArray[np.uint8]
    count: int = 0

    def __post_init__(self) -> None:
        self.arrays = RowArrays(self.h, self.z, self.w, self.robust)

    def add(self, values: FloatArray, z: float, sigma: float, robust: bool = False) -> None:
        """Append one row; ``values`` (N,)."""
        if self.count < len(self.z):
            self.h[self.count] = values
            self.z[self.count] = z
            self.w[self.count] = 1.0 / sigma**2
            self.robust[self.count] = robust
            self.count += 1

    def add_end(
        self,
        pose: EndPose,
        axis: tuple[float, float],
        turn: float,
        shares: tuple[float, float],
        z: float,
        sigma: float,
        constant: tuple[int, float] = (-1, 0.0),
        robust: bool = False,
    ) -> None:
        """Append what an end says (see :func:`end_row`): shares of place and rate, constant and its slope."""
        k = self.count
        if k < len(self.z):
            end_row(k, pose.jacobian, pose.angle_row, *axis, turn, *shares, *constant, self.h)
            self.z[k] = z
            self.w[k] = 1.0 / sigma**2
            self.robust[k] = robust
            self.count = k + 1
