"""The frame branch alone: a tracker that holds the newest shapes of the frames and looks at no event."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from motiondlo.events.types import EventBatch
from motiondlo.geometry.curve import left_normals, tangents
from motiondlo.rejects import RejectReason
from motiondlo.tracking.types import Correction, CorrectionKind, TrackSource, TrackState, TrackUpdate


class FrameHoldTracker:
    """An :class:`~motiondlo.tracking.types.EventTracker` for ``--mode frame``: what events add is the difference."""

    def __init__(self) -> None:
        self._held: dict[int, TrackState] = {}
        self._waiting: list[Correction] = []
        self._t_events_us = -1

    def correct(self, correction: Correction) -> RejectReason | None:
        """Keep it until its time; nothing but an older shape than the one held is refused."""
        held = self._held.get(correction.id)
        if held is not None and correction.t_us < held.t_corrected_us:
            return RejectReason.OUT_OF_ORDER
        self._waiting.append(correction)
        return None

    def update(self, batch: EventBatch) -> TrackUpdate:
        """The shapes that have arrived by the batch's end, as they were when their frames were taken."""
        if len(batch.events):
            self._t_events_us = int(batch.events["t"][-1])
        due = [correction for correction in self._waiting if correction.not_before_us <= batch.t1_us]
        self._waiting = [correction for correction in self._waiting if correction.not_before_us > batch.t1_us]
        for correction in due:
            if correction.kind is CorrectionKind.RETIRE:
                self._held.pop(correction.id, None)
            else:
                self._held[correction.id] = _state_of(correction)
        return TrackUpdate(
            t_us=batch.t1_us,
            t_events_us=self._t_events_us,
            tracks=tuple(self._held[i] for i in sorted(self._held)),
            events=len(batch.events),
        )


def _state_of(correction: Correction) -> TrackState:
    nodes = correction.nodes
    return TrackState(
        id=correction.id,
        nodes=nodes,
        velocity_px_s=np.zeros_like(nodes),
        cov_px2=_covariance(nodes, correction.sigma_normal_px, correction.sigma_tangent_px),
        visible=np.ones(len(nodes), np.uint8),
        diameter_px=correction.diameter_px,
        confidence=1.0,
        moving=False,
        source=TrackSource.FRAME,
        t_corrected_us=correction.t_us,
    )


def _covariance(
    nodes: npt.NDArray[np.float64], normal_px: npt.NDArray[np.float64], tangent_px: npt.NDArray[np.float64]
) -> npt.NDArray[np.float64]:
    """(M, 3) xx, xy, yy from standard deviations across and along the curve."""
    t = tangents(nodes)
    n = left_normals(t)
    a, b = tangent_px**2, normal_px**2
    return np.stack(
        [
            a * t[:, 0] ** 2 + b * n[:, 0] ** 2,
            a * t[:, 0] * t[:, 1] + b * n[:, 0] * n[:, 1],
            a * t[:, 1] ** 2 + b * n[:, 1] ** 2,
        ],
        axis=1,
    )
