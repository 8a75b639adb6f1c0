"""What a chain tells the outside: equidistant nodes from end to end, and how far they can be trusted."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from motiondlo.events.types import SensorGeometry
from motiondlo.tracking.chain import filter_kernels
from motiondlo.tracking.chain.filter_state import ChainFilter
from motiondlo.tracking.chain.spline import weights
from motiondlo.tracking.chain.stations import Stations, tangential_part

FloatArray = npt.NDArray[np.float64]

_FADE_MS = 8.0
_USUAL_SHARE = 0.7
_SLIPPED_PX = 30.0
_UNMATCHED_MS = 10.0
_NARROW_VIEW = 0.25
_UNSEEN_SIGMA_PX = 50.0


class Report:
    """Output nodes at equal distances between two material coordinates."""

    def __init__(self, count: int, nodes: int, bias_px: float, bias_along_px: float) -> None:
        """bias_px, bias_along_px: what all places have in common and the filter does not know, across and along."""
        self._count = count
        self._nodes = nodes
        self._bias_px = bias_px
        self._along_px2 = max(bias_along_px**2 - bias_px**2, 0.0)
        self._g = np.zeros((count, 10))
        self._cov = np.zeros((count, 3))
        self.set_extent(0.0, nodes - 3.0)

    def set_extent(self, u_first: float, u_last: float) -> None:
        """From where to where the DLO is believed to exist."""
        self.u = np.linspace(max(u_first, 0.0), min(u_last, self._nodes - 3.0), self._count)
        self._places = weights(self.u, self._nodes)

    def take(self, f: ChainFilter) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Nodes (M, 2) px, velocities (M, 2) px/s, covariances (M, 3) px^2 with the common bias."""
        j0, w, w1, w2 = self._places
        filter_kernels.place(f.x, f.K, j0, w, w1, w2, self._g)
        filter_kernels.place_covariance(f.P, f.K, j0, w, self._cov, False)
        cov = self._cov.copy()
        cov[:, 0] += self._bias_px**2
        cov[:, 2] += self._bias_px**2
        tx, ty = self._g[:, 2], self._g[:, 3]
        cov += self._along_px2 * np.stack([tx * tx, tx * ty, ty * ty], axis=1)
        return self._g[:, :2].copy(), self._g[:, 4:6] * 1e3, cov


class Judgement:
    """Confidence: how much of what should be seen is seen, how sure the place along the DLO is, how surprised it is."""

    def __init__(self) -> None:
        self.confidence = 1.0
        self._seen_share = _USUAL_SHARE

    def update(self, stations: Stations, dt_ms: float, moving: bool, boost: float, unmatched_ms: float) -> None:
        """unmatched_ms: how long the patch of an end has made events that fit it nowhere."""
        there = stations.inside & stations.exists
        expected = there & (stations.support_ms > 0.0)
        expected &= (stations.out[:, 3] >= stations.params.min_events) | (np.abs(stations.g[:, 6]) > 0.7)
        a = 1.0 - float(np.exp(-dt_ms / _FADE_MS))
        if expected.sum() >= 3:
            share = float((stations.use & expected).sum()) / float(expected.sum())
            self._seen_share += a * (share - self._seen_share)
        elif moving:
            self._seen_share -= 0.3 * a * self._seen_share
        along = tangential_part(stations.cov_place, stations.g)[there]
        sigma_t = float(np.sqrt(max(float(np.median(along)), 0.0))) if len(along) else _UNSEEN_SIGMA_PX
        in_view = float(there.sum()) / max(float(stations.exists.sum()), 1.0)
        self.confidence = float(
            np.clip(self._seen_share / _USUAL_SHARE, 0.0, 1.0)
            / (1.0 + (sigma_t / _SLIPPED_PX) ** 2)
            / (1.0 + unmatched_ms / _UNMATCHED_MS)
            / (1.0 + 0.05 * (boost - 1.0))
            * min(1.0, float(np.sqrt(in_view / _NARROW_VIEW)))
        )


def inside_image(nodes: FloatArray, geometry: SensorGeometry) -> npt.NDArray[np.bool_]:
    """(M,) whether nodes lie on the sensor."""
    x, y = nodes[:, 0], nodes[:, 1]
    return np.asarray((x >= 0) & (y >= 0) & (x <= geometry.width_px - 1) & (y <= geometry.height_px - 1))
