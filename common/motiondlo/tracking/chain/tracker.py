"""The chain tracker: any number of DLOs, each a Kalman filter over control nodes, on one surface of event times."""

from __future__ import annotations

from time import perf_counter_ns

import numpy as np

from motiondlo.events.surface import TimeSurface
from motiondlo.events.types import EventBatch, SensorGeometry
from motiondlo.rejects import RejectReason
from motiondlo.tracking.chain.chain import Chain
from motiondlo.tracking.chain.late import PastShape, absorb, carried_forward
from motiondlo.tracking.chain.near_kernels import TILE_SHIFT
from motiondlo.tracking.chain.params import ChainParams
from motiondlo.tracking.correction_gate import CorrectionGate
from motiondlo.tracking.types import Correction, CorrectionKind, TrackUpdate


class ChainTracker:
    """Implements :class:`motiondlo.tracking.types.EventTracker`."""

    def __init__(self, params: ChainParams, geometry: SensorGeometry, timed: bool = False) -> None:
        """timed: updates tell the host's time per stage."""
        self._timed = timed
        self.params = params
        self.geometry = geometry
        self._surface = TimeSurface(geometry)
        self._chains: dict[int, Chain] = {}
        self._gate: CorrectionGate[PastShape] = CorrectionGate(params.history_ms * 1000)
        shape = ((geometry.height_px >> TILE_SHIFT) + 1, (geometry.width_px >> TILE_SHIFT) + 1)
        self._grid = np.zeros(shape, np.uint32)
        self._marked = False
        self._now_us = -1
        self._newest_us = -1

    def warm_up(self) -> None:
        """Compile, or load from the cache, everything that an update needs."""
        from motiondlo.tracking.chain.warm import exercise

        exercise(self.params)

    def correct(self, correction: Correction) -> RejectReason | None:
        """Take a correction (kept until ``not_before_us`` if that lies ahead); a reason if it is refused."""
        reason = self._gate.admit(correction, self._now_us)
        if reason is None and self._now_us >= 0 and correction.not_before_us <= self._now_us:
            # Due at once: judged at once, so that the sender learns whether it is plausible.
            reason = self._apply_due(self._now_us)
        return reason

    def update(self, batch: EventBatch) -> TrackUpdate:
        """Advance to ``batch.t1_us``. A gap before the batch is bridged by prediction."""
        start = perf_counter_ns()
        before_us = self._now_us if self._now_us >= 0 else batch.t0_us
        self._apply_due(batch.t1_us)
        e = batch.events
        steps = self._steps(batch)
        ends = np.searchsorted(e["t"], steps) if len(steps) > 1 else np.array([len(e)])
        surface_ns = 0
        first = 0
        for end_us, last in zip(steps, ends, strict=True):
            began = perf_counter_ns()
            if last > first:
                self._surface.update(e[first:last])
            surface_ns += perf_counter_ns() - began
            self._step(end_us, max((end_us - before_us) * 1e-3, 1e-3))
            before_us, first = end_us, last
        if len(e):
            self._newest_us = int(e["t"][-1])
        self._now_us = batch.t1_us
        stepped = perf_counter_ns()
        tracks = []
        for chain in self._chains.values():
            if not chain.asleep:
                self._gate.history(chain.id).record(batch.t1_us, PastShape.of(chain))
            tracks.append(chain.state())
        stages: dict[str, int] = {}
        if self._timed:
            done = perf_counter_ns()
            stages = {"surface": surface_ns, "filter": stepped - start - surface_ns, "report": done - stepped}
        return TrackUpdate(
            t_us=batch.t1_us,
            t_events_us=self._newest_us,
            tracks=tuple(tracks),
            events=len(e),
            active_ratio=self._active_ratio(),
            stages_ns=stages,
            rejects=self._gate.rejects.as_dict(),
        )

    def _steps(self, batch: EventBatch) -> list[int]:
        """Ends of the steps in which a batch is worked off: fast motion needs short ones, merged batches are long."""
        span_us = batch.t1_us - batch.t0_us
        count = int(np.clip(round(span_us / (1000.0 * self.params.step_ms)), 1, self.params.most_steps))
        return [batch.t0_us + span_us * (k + 1) // count for k in range(count)]

    def _step(self, t_us: int, dt_ms: float) -> None:
        self._mark_movers()
        for k, chain in enumerate(self._chains.values()):
            chain.stations.look_around(self._grid, k % 32)
            chain.step(self._surface.last_us, t_us, dt_ms)

    def _mark_movers(self) -> None:
        if self._marked:
            self._grid[:] = 0
            self._marked = False
        if len(self._chains) < 2:
            return
        for k, chain in enumerate(self._chains.values()):
            if chain.passes_others:
                chain.mark(self._grid, k % 32)
                self._marked = True

    def _active_ratio(self) -> float:
        area = sum(chain.active_px for chain in self._chains.values())
        return float(area / (self.geometry.width_px * self.geometry.height_px))

    def _apply_due(self, now_us: int) -> RejectReason | None:
        """Apply what is due, between two updates; the reason of the last one that was refused."""
        refused: RejectReason | None = None
        for correction in self._gate.due(now_us):
            if not self._gate.still_valid(correction, now_us):
                continue
            chain = self._chains.get(correction.id)
            if correction.kind is CorrectionKind.RETIRE:
                self._chains.pop(correction.id, None)
                self._gate.retired(correction.id)
            elif correction.kind is CorrectionKind.REINITIALISE:
                history = self._gate.history(correction.id) if chain is not None else None
                past = history.at(correction.t_us) if history is not None else None
                shape = correction if chain is None or past is None else carried_forward(correction, chain, past)
                fresh = Chain(shape, self.params, self.geometry)
                fresh.reinitialised = 0 if chain is None else chain.reinitialised + 1
                fresh.t_corrected_us = correction.t_us
                self._chains[correction.id] = fresh
                self._gate.started(correction.id, correction.t_us)
                self._gate.history(correction.id).record(correction.t_us, PastShape.of(fresh))
                self._gate.absorbed(correction)
            elif chain is not None:
                history = self._gate.history(correction.id)
                past = history.at(correction.t_us)
                change = absorb(chain, past, correction) if past is not None else None
                if change is None:
                    self._gate.rejects.count(RejectReason.IMPLAUSIBLE)
                    refused = RejectReason.IMPLAUSIBLE
                    continue
                history.revise(correction.t_us, change)
                chain.t_corrected_us = correction.t_us
                self._gate.absorbed(correction)
        return refused
