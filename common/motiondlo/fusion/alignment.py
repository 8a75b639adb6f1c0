"""A small correction of the homography, learned while the cell runs: guarded, and taken back when it stops helping.

Whenever a DLO has moved since its last shape, the events have had their own say about where it is: its track and the
frame's shape are a pair for :class:`HomographyRefinement`. What that proposes is applied after the given homography, to
event px, so neither the segmenter nor the calibration file changes.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from motiondlo.events.types import SensorGeometry
from motiondlo.geometry.curve import distance_to_curve, left_normals, tangents
from motiondlo.geometry.homography import warp_points
from motiondlo.geometry.homography_refinement import CurvePair, HomographyRefinement
from motiondlo.tracking.types import TrackState

FloatArray = npt.NDArray[np.float64]

_LEAST_CONFIDENCE = 0.5
_EVERY = 3
_WATCHED = 6
"""Pairs since a correction was taken over by which it is judged again."""


@dataclass(frozen=True)
class _Gap:
    given_px: float
    corrected_px: float


class FrameAlignment:
    """Learns from shapes of DLOs that moved; corrects shapes. No I/O, no clock."""

    def __init__(self, sensor: SensorGeometry | None = None) -> None:
        self._sensor = SensorGeometry() if sensor is None else sensor
        self._moved: set[int] = set()
        self._gaps: deque[_Gap] = deque(maxlen=_WATCHED)
        self._refinement = self._fresh()
        self._pairs = 0
        self.corrections = 0
        """How often a correction was taken over."""
        self.reverted = 0
        """How often one was taken back."""

    @property
    def active(self) -> bool:
        """Whether shapes are corrected now."""
        return not np.array_equal(self._refinement.event_from_rgb, np.eye(3))

    def aligned(self, curve: FloatArray) -> FloatArray:
        """A frame's curve, (M, 2) event px by the given homography, where the correction puts it."""
        return warp_points(curve, self._refinement.event_from_rgb) if self.active else curve

    def saw(self, tracks: tuple[TrackState, ...]) -> None:
        """Take a track update: which DLOs move."""
        self._moved |= {track.id for track in tracks if track.moving}

    def learn(self, curve: FloatArray, sigma_px: FloatArray, track: TrackState) -> None:
        """Take a frame's curve (by the given homography) that was matched with a track at its own time.

        curve: (M, 2) event px, sigma_px: (M,) along its normals.
        """
        if track.id not in self._moved or track.confidence < _LEAST_CONFIDENCE or track.moving:
            return  # it stands where a frame put it, or moved in the exposure: no second opinion
        self._moved.discard(track.id)
        n, cov = left_normals(tangents(track.nodes)), track.cov_px2
        variance = n[:, 0] ** 2 * cov[:, 0] + 2.0 * n[:, 0] * n[:, 1] * cov[:, 1] + n[:, 1] ** 2 * cov[:, 2]
        across = np.sqrt(np.maximum(variance, 0.0))
        self._refinement.add(CurvePair(track.id, curve, sigma_px, track.nodes, across, track.visible))
        if self.active:
            self._watch(curve, track)
        self._pairs += 1
        # A proposal costs tens of ms.
        if self._pairs % _EVERY == 0 and self._refinement.propose().accepted:
            self.corrections += 1
            self._gaps.clear()

    def _watch(self, curve: FloatArray, track: TrackState) -> None:
        """Take the correction back when the newest pairs are farther apart with it than without."""
        given, corrected = (float(distance_to_curve(c, track.nodes).mean()) for c in (curve, self.aligned(curve)))
        self._gaps.append(_Gap(given, corrected))
        if len(self._gaps) == _WATCHED and sum(gap.corrected_px - gap.given_px for gap in self._gaps) > 0.0:
            self._refinement = self._fresh()
            self._gaps.clear()
            self.reverted += 1

    def _fresh(self) -> HomographyRefinement:
        return HomographyRefinement(np.eye(3), (self._sensor.width_px, self._sensor.height_px))
