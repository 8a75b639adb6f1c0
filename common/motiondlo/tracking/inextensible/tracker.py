"""The inextensible tracker: any number of DLOs on one time surface."""

from __future__ import annotations

import numpy as np

from motiondlo.events.types import EventBatch, SensorGeometry
from motiondlo.rejects import RejectReason
from motiondlo.tracking.correction_gate import CorrectionGate
from motiondlo.tracking.inextensible.dlo import InextensibleDlo, PastState
from motiondlo.tracking.inextensible.params import InextensibleParams
from motiondlo.tracking.types import Correction, CorrectionKind, TrackUpdate


class InextensibleTracker:
    """Implements :class:`motiondlo.tracking.types.EventTracker`."""

    def __init__(self, params: InextensibleParams, geometry: SensorGeometry) -> None:
        self.params = params
        self.geometry = geometry
        self.surface = np.full((2, geometry.height_px, geometry.width_px), -(10**12), np.int64)
        self.dlos: dict[int, InextensibleDlo] = {}
        self.gate: CorrectionGate[PastState] = CorrectionGate()
        self.t_us = 0
        self.t_events_us = -1

    def correct(self, correction: Correction) -> RejectReason | None:
        reason = self.gate.admit(correction, self.t_us)
        return reason

    def update(self, batch: EventBatch) -> TrackUpdate:
        for correction in self.gate.due(batch.t0_us):
            if correction.kind is CorrectionKind.REINITIALISE:
                self.dlos[correction.id] = InextensibleDlo(correction, self.params, self.geometry)
                self.gate.started(correction.id, batch.t0_us)
                self.gate.absorbed(correction)
        dt_ms = (batch.t1_us - self.t_us) * 1e-3 if self.t_us else (batch.t1_us - batch.t0_us) * 1e-3
        e = batch.events
        self.surface[e["p"], e["y"], e["x"]] = e["t"]
        if len(e):
            self.t_events_us = int(e["t"][-1])
        for dlo in self.dlos.values():
            dlo.step(self.surface, batch.t1_us, dt_ms)
        self.t_us = batch.t1_us
        return TrackUpdate(self.t_us, self.t_events_us, tuple(d.state() for d in self.dlos.values()), events=len(e))
