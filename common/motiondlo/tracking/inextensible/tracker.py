"""The inextensible tracker: any number of DLOs on one time surface."""

from __future__ import annotations

import math
import time

import numpy as np

from motiondlo.events.buckets import EventBuckets
from motiondlo.events.screening import EventScreening
from motiondlo.events.types import EventBatch, SensorGeometry
from motiondlo.rejects import RejectReason
from motiondlo.tracking.carrying import carried_correction
from motiondlo.tracking.correction_gate import CorrectionGate
from motiondlo.tracking.inextensible.confidence import UnexplainedEvents
from motiondlo.tracking.inextensible.curve_filter import GAP_MS
from motiondlo.tracking.inextensible.dlo import InextensibleDlo
from motiondlo.tracking.inextensible.late import PastState
from motiondlo.tracking.inextensible.near_kernels import MASK_BITS, count_near, mark_tiles
from motiondlo.tracking.inextensible.params import InextensibleParams, screening_of
from motiondlo.tracking.inextensible.rivals import make_rivals
from motiondlo.tracking.types import Correction, CorrectionKind, TrackUpdate


class InextensibleTracker:
    """Implements :class:`motiondlo.tracking.types.EventTracker` with curves that cannot stretch."""

    def __init__(self, params: InextensibleParams, geometry: SensorGeometry, timed: bool = False) -> None:
        """timed: report the host time of each stage with every update."""
        self.params = params
        self.geometry = geometry
        self._surface = EventBuckets(geometry)
        self.screening = EventScreening(screening_of(params), self._surface)
        self._dlos: dict[int, InextensibleDlo] = {}
        self._gate: CorrectionGate[PastState] = CorrectionGate()
        self._t_us = -1
        self._t_events_us = -1
        self._timed = timed
        self._tiles = np.zeros(self.screening.counts.shape, np.uint32)
        self._tiles_stale = True
        self._counts = np.zeros(MASK_BITS, np.int64)
        self._unexplained = UnexplainedEvents()

    def warm_up(self) -> None:
        """Compile or load all kernels; takes a few seconds without a cache."""
        from motiondlo.tracking.inextensible.warm_up import run_small_scene

        run_small_scene(self.params)

    def correct(self, correction: Correction) -> RejectReason | None:
        """Take a correction (kept until ``not_before_us`` if that lies ahead); a reason if it is refused.

        One that is due at once is judged at once, so that the sender learns whether it is plausible.
        """
        now_us = max(self._t_us, 0)
        reason = self._gate.admit(correction, now_us)
        if reason is None and correction.not_before_us <= now_us and self._t_us >= 0:
            before = self._gate.rejects.as_dict()
            self._apply_due(now_us)
            after = self._gate.rejects.as_dict()
            for name, count in after.items():
                if count > before.get(name, 0):
                    reason = RejectReason(name)
        return reason

    def update(self, batch: EventBatch) -> TrackUpdate:
        """Advance to ``batch.t1_us``. A gap before the batch is bridged by prediction."""
        clock = time.perf_counter_ns
        start_ns = clock()
        self._apply_due(max(batch.t0_us, 0))
        if batch.t1_us <= self._t_us:
            # Time went back: what the surface holds lies in the future.
            self.screening.clear()
            self._t_us = batch.t0_us
        since_us = batch.t0_us if self._t_us < 0 else min(self._t_us, batch.t0_us)
        span_ms = max(batch.t1_us - since_us, 1) * 1e-3
        events = batch.events
        if len(events):
            self._t_events_us = int(events["t"][-1])
        self._count_near(batch)
        self._unexplained.advance(span_ms, len(events), int(self._counts.sum()))
        for dlo in self._dlos.values():
            dlo.unexplained = self._unexplained.share
        near_ns = clock()
        awake = [
            dlo
            for dlo in self._dlos.values()
            if dlo.stirred(int(self._counts[dlo.id % MASK_BITS]), span_ms) or not dlo.asleep
        ]
        # Events older than the prediction can bridge are worth little: batches are taken in steps.
        step_ms = self.params.slow_step_ms if self._slow(awake) else self.params.step_ms
        # Across missing batches one step is predicted: shorter ones would take their silence for rest.
        missing = 0 <= self._t_us < batch.t0_us
        steps = 1 if missing or span_ms > GAP_MS or not awake else max(1, math.ceil(span_ms / step_ms - 1e-6))
        edges_us, cuts = [since_us, batch.t1_us], [0, len(events)]
        if steps > 1:
            edges_us = np.linspace(since_us, batch.t1_us, steps + 1).astype(np.int64).tolist()
            cuts[1:1] = np.searchsorted(events["t"], edges_us[1:-1]).tolist()
        surface_ns = 0
        for k in range(steps):
            before_ns = clock()
            self.screening.file(events[cuts[k] : cuts[k + 1]])
            surface_ns += clock() - before_ns
            for dlo in awake:
                was_frozen = dlo.frozen
                dt_ms = (edges_us[k + 1] - edges_us[k]) * 1e-3
                if self.screening.flash:
                    dlo.coast(dt_ms)
                else:
                    dlo.step(self._surface, edges_us[k + 1], dt_ms)
                if not dlo.frozen or not was_frozen:
                    self._gate.history(dlo.id).record(edges_us[k + 1], dlo.past_state())
                    self._tiles_stale = True
        active_pixels = sum(int(self._counts[dlo.id % MASK_BITS]) for dlo in awake if dlo.moving)
        self._t_us = batch.t1_us
        tracks_ns = clock()
        tracks = tuple(dlo.state() for dlo in self._dlos.values())
        stages = {}
        if self._timed:
            stages = {
                "near": near_ns - start_ns,
                "surface": surface_ns,
                "tracks": tracks_ns - near_ns - surface_ns,
                "result": clock() - tracks_ns,
            }
        return TrackUpdate(
            t_us=batch.t1_us,
            t_events_us=self._t_events_us,
            tracks=tracks,
            active_ratio=min(1.0, active_pixels / (self.geometry.width_px * self.geometry.height_px)),
            events=len(events),
            stages_ns=stages,
            rejects=self._gate.rejects.as_dict(),
            disturbed="a flash: its events are left out" if self.screening.flash else "",
        )

    def _slow(self, awake: list[InextensibleDlo]) -> bool:
        """Whether everything that moves has moved slowly for a while, and nothing has just begun to."""
        p = self.params
        return all(p.onset_velocity <= dlo.recent_speed < p.slow_velocity for dlo in awake)

    def _count_near(self, batch: EventBatch) -> None:
        """Screen the batch; its events near every DLO; the tiles are drawn anew where a DLO has moved."""
        self._counts[:] = 0
        if self._tiles_stale:
            self._tiles[:] = 0
            for dlo in self._dlos.values():
                mark_tiles(
                    dlo.points, dlo.radius_px + 4.0, dlo.id % MASK_BITS, self.geometry.width_px,
                    self.geometry.height_px, self._tiles,
                )  # fmt: skip
            self._tiles_stale = False
        moving_bits = 0
        for dlo in self._dlos.values():
            moving_bits |= 0 if dlo.frozen else 1 << dlo.id % MASK_BITS
        self.screening.look(batch, self._tiles, moving_bits)
        if not self.screening.flash:
            count_near(self.screening.counts, self._tiles, self._counts)

    def _apply_due(self, now_us: int) -> None:
        for correction in self._gate.due(now_us):
            if not self._gate.still_valid(correction, now_us):
                continue
            if correction.kind is CorrectionKind.RETIRE:
                self._dlos.pop(correction.id, None)
                self._gate.retired(correction.id)
                self._seat_rivals()
                self._tiles_stale = True
            elif correction.kind is CorrectionKind.REINITIALISE:
                self._start(correction, now_us)
                self._gate.absorbed(correction)
            else:
                past = self._gate.history(correction.id).at(correction.t_us)
                if past is not None and self._dlos[correction.id].blend(correction, past, now_us):
                    self._gate.absorbed(correction)
                    # One at rest has no other entries: the next shape would be compared with what was before this one.
                    self._gate.history(correction.id).record(now_us, self._dlos[correction.id].past_state())
                    self._tiles_stale = True
                else:
                    self._gate.rejects.count(RejectReason.IMPLAUSIBLE)

    def _start(self, correction: Correction, now_us: int) -> None:
        before = self._dlos.get(correction.id)
        correction = carried_correction(correction, now_us)
        dlo = InextensibleDlo(correction, self.params, self.geometry)
        dlo.reinitialised = 0 if before is None else before.reinitialised + 1
        self._dlos[correction.id] = dlo
        self._seat_rivals()
        # Corrections for times between the shape's and now speak of the same track.
        self._gate.started(correction.id, min(correction.t_us, now_us))
        self._gate.history(correction.id).record(min(correction.t_us, now_us), dlo.past_state())
        self._tiles_stale = True

    def _seat_rivals(self) -> None:
        """Give every DLO its block of rows among those that tell where all of them are."""
        dlos = list(self._dlos.values())
        rivals = make_rivals([dlo.m for dlo in dlos], [dlo.profile.shape[2] for dlo in dlos])
        for block, dlo in enumerate(dlos):
            dlo.rivals, dlo.block = rivals, block
            for end in dlo.ends:
                end.rivals, end.block = rivals, block
            dlo.lay_out(max(self._t_us, 0))
