"""The paper's event tracker: one moving DLO at a time, the others held where a frame last saw them."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from motiondlo.events.surface import TimeSurface
from motiondlo.events.types import EventArray, EventBatch, SensorGeometry
from motiondlo.geometry.curve import arc_length, resample
from motiondlo.rejects import RejectReason
from motiondlo.tracking.correction_gate import CorrectionGate
from motiondlo.tracking.paper.blending import innovation, runs_backwards
from motiondlo.tracking.paper.endpoints import extend_ends, within_length, within_reach
from motiondlo.tracking.paper.event_mask import active_cells, active_ratio, refined
from motiondlo.tracking.paper.geodesic import (
    chain_coordinates,
    mct_kernel,
    node_distances,
    updated_velocity,
    warm_start,
)
from motiondlo.tracking.paper.hibernation import Hibernation
from motiondlo.tracking.paper.noise_filter import NoiseFilter
from motiondlo.tracking.paper.observations import Observations, observe
from motiondlo.tracking.paper.params import PaperParams
from motiondlo.tracking.paper.recentness import AdaptiveDecay, longest_ages_us
from motiondlo.tracking.paper.recovery import RecoveryMonitor
from motiondlo.tracking.paper.region import Region, cell_size_px, tube_around, whole_sensor
from motiondlo.tracking.paper.registration import register, respaced
from motiondlo.tracking.paper.stage_clock import StageClock
from motiondlo.tracking.paper.track import PastState, Track
from motiondlo.tracking.types import Correction, CorrectionKind, TrackSource, TrackUpdate

FloatArray = npt.NDArray[np.float64]

# A centreline of less than this share of the known length, as far as that lies in the image, is a part of the DLO: no
# place to start the whole anew from.
_RESTART_SHARE = 0.7
# Observations nearer to the curve than this, on average, are explained by it.
_EXPLAINED_DIAMETERS = 0.3
# Without a track the whole sensor is looked at, every so many updates.
_SEARCH_EVERY = 5
_SELF_STARTED_ID = 0


class PaperTracker:
    """``EventTracker`` after the paper. Deterministic; time comes in with the batches.

    Events are taken in batches of any length and registered every ``period_us``; in between, the last estimate stands.
    """

    def __init__(self, params: PaperParams, geometry: SensorGeometry) -> None:
        self._params = params
        self._geometry = geometry
        self._filter = NoiseFilter(params, geometry)
        self._surface = TimeSurface(geometry)
        self._decay = AdaptiveDecay(params)
        self._gate: CorrectionGate[PastState] = CorrectionGate(params.history_us)
        self._tracks: dict[int, Track] = {}
        self._focus: int | None = None
        self._self_started = False
        self._now_us = 0
        self._stepped_us: int | None = None
        self._events_since_step = 0
        self._t_events_us = -1
        self._rho = 0.0
        self._searches = 0
        self._lines_in_a_row = 0

    # corrections

    def correct(self, correction: Correction) -> RejectReason | None:
        """Take a correction; it is applied by the first update at or after its ``not_before_us``."""
        return self._gate.admit(correction, self._now_us)

    def _apply_due(self, now_us: int) -> None:
        for correction in self._gate.due(now_us):
            if not self._gate.still_valid(correction, now_us):
                continue
            if correction.kind is CorrectionKind.RETIRE:
                self._retire(correction.id)
            elif correction.kind is CorrectionKind.REINITIALISE:
                self._start(correction, now_us)
            elif self._params.correction_blend:
                self._blend(correction)
            self._gate.absorbed(correction)

    def _start(self, correction: Correction, now_us: int) -> None:
        if self._self_started:
            # What the events alone suggested gives way to the first shape that a frame has seen.
            self._retire(_SELF_STARTED_ID)
            self._self_started = False
        track = self._tracks.get(correction.id)
        diameter_px = correction.diameter_px or (track.diameter_px if track else self._params.default_diameter_px)
        since_us = now_us
        if track is None:
            # The first shape holds from its frame on: until then nobody knew of the DLO.
            track = self._new_track(correction.id, correction.nodes, diameter_px)
            since_us = min(correction.t_us, now_us)
        else:
            track.start(correction.nodes)
            track.reinitialised += 1
        track.diameter_px = diameter_px
        track.rest_length_px = float(arc_length(correction.nodes)[-1])
        track.t_corrected_us = correction.t_us
        track.source = TrackSource.FRAME
        track.confidence = 1.0
        self._gate.started(track.id, since_us)
        self._gate.history(track.id).record(since_us, track.past())

    def _blend(self, correction: Correction) -> None:
        track = self._tracks[correction.id]
        history = self._gate.history(track.id)
        past = history.at(correction.t_us)
        if past is None:
            return
        shift = innovation(past, correction.nodes, correction.sigma_normal_px, track.moved_us, self._params)
        nodes = respaced(track.nodes + shift)
        if nodes is None:
            return
        track.nodes = nodes
        history.revise(correction.t_us, lambda old: PastState(old.nodes + shift, old.variance_px2, old.moved_us))
        track.t_corrected_us = correction.t_us
        track.rest_length_px = float(arc_length(correction.nodes)[-1])
        if correction.diameter_px > 0.0:
            track.diameter_px = correction.diameter_px
        if not track.hibernation.moving:
            track.source = TrackSource.FRAME
            track.confidence = 1.0

    def _new_track(self, dlo_id: int, nodes: FloatArray, diameter_px: float) -> Track:
        p = self._params
        track = Track(dlo_id, nodes, diameter_px, 0.0, p, Hibernation(p), RecoveryMonitor(p))
        self._tracks[dlo_id] = track
        return track

    def _retire(self, dlo_id: int) -> None:
        self._tracks.pop(dlo_id, None)
        self._gate.retired(dlo_id)
        if self._focus == dlo_id:
            self._focus = None

    # updates

    def update(self, batch: EventBatch) -> TrackUpdate:
        """Advance to ``batch.t1_us``. A batch that ends before the last one is refused and counted."""
        clock = StageClock()
        if self._stepped_us is not None and batch.t1_us <= self._now_us:
            self._gate.rejects.count(RejectReason.TIME_BACKWARDS)
            return self._publish(len(batch.events), clock)
        self._now_us = batch.t1_us
        self._take(batch.events, clock)
        self._apply_due(self._now_us)
        clock.lap("corrections")
        if self._stepped_us is None:
            self._stepped_us = batch.t0_us
        if self._now_us - self._stepped_us >= self._params.period_us:
            self._step(self._now_us, self._now_us - self._stepped_us, clock)
            self._stepped_us = self._now_us
            self._events_since_step = 0
        return self._publish(len(batch.events), clock)

    def _take(self, events: EventArray, clock: StageClock) -> None:
        if len(events) == 0:
            return
        self._t_events_us = int(events["t"][-1])
        if self._params.noise_filter:
            events = self._filter.filter(events)
            clock.lap("noise_filter")
        if not self._params.polarity_separated:
            events = events.copy()
            events["p"] = 0
        self._surface.update(events)
        self._events_since_step += len(events)
        clock.lap("time_surfaces")

    def _publish(self, events: int, clock: StageClock) -> TrackUpdate:
        tracks = tuple(self._tracks[dlo_id].state() for dlo_id in sorted(self._tracks))
        clock.lap("publish")
        return TrackUpdate(
            t_us=self._now_us,
            t_events_us=self._t_events_us,
            tracks=tracks,
            active_ratio=self._rho,
            events=events,
            stages_ns=clock.stages_ns,
            rejects=self._gate.rejects.as_dict(),
        )

    def _step(self, now_us: int, dt_us: int, clock: StageClock) -> None:
        tau_us = self._decay.update(self._events_since_step, dt_us)
        if not self._tracks:
            self._search(now_us, tau_us, clock)
            return
        track = self._tracks.get(-1 if self._focus is None else self._focus)
        if track is None or not track.hibernation.moving:
            track = self._nearest_to_activity(now_us, tau_us, clock)
        if track is not None:
            self._advance(track, now_us, dt_us, tau_us, clock)

    def _nearest_to_activity(self, now_us: int, tau_us: float, clock: StageClock) -> Track | None:
        """The DLO along which most pixels are active (paper: the moving DLO is the one that causes events)."""
        best: Track | None = None
        most = 0.0
        for track in self._tracks.values():
            region = self._region(track, track.nodes, 0.0)
            if region is None:
                continue
            cells = active_cells(self._surface.last_us, region, now_us, tau_us, track.diameter_px, self._params)
            active = active_ratio(cells, region, self._geometry)
            if active > most:
                best, most = track, active
        clock.lap("activity")
        self._focus = best.id if best is not None else None
        self._rho = 0.0
        return best

    def _region(self, track: Track, curve: FloatArray, moved_px: float) -> Region | None:
        p = self._params
        cell_px = cell_size_px(p, track.diameter_px)
        if not p.region_of_interest:
            return whole_sensor(self._geometry, cell_px)
        half_width_px = p.roi_half_width_diameters * track.diameter_px + p.roi_speed_gain * moved_px
        return tube_around(curve, half_width_px, self._geometry, cell_px)

    def _advance(self, track: Track, now_us: int, dt_us: int, tau_us: float, clock: StageClock) -> None:
        """One update of the DLO in focus: predict, look, register, extend, recover."""
        p = self._params
        moving = track.hibernation.moving
        predicted = self._predict(track, dt_us)
        clock.lap("warm_start")
        region = self._region(track, predicted, float(np.hypot(*(predicted - track.nodes).T).max()))
        longest_us = None
        if p.motion_limited_decay and p.region_of_interest:
            longest_us = longest_ages_us(
                track.velocity_px_s, predicted, p.trail_diameters * track.diameter_px, float(p.period_us)
            )
        active = None
        self._rho = 0.0
        if region is not None:
            active = active_cells(self._surface.last_us, region, now_us, tau_us, track.diameter_px, p, longest_us)
            self._rho = active_ratio(active, region, self._geometry)
        clock.lap("recentness")
        if not track.hibernation.update(self._rho):
            if moving:
                track.at_rest()
                self._gate.history(track.id).record(now_us, track.past())
            return
        track.moved_us += dt_us
        seen = None
        if region is not None and active is not None:
            mask = refined(active, region, track.diameter_px, p)
            clock.lap("morphology")
            seen = observe(mask, region, track.diameter_px, predicted, track.rest_length_px, p, clock)
        if seen is None or not self._register(track, predicted, seen, now_us, dt_us, tau_us, clock):
            coasting = respaced(predicted)
            track.nodes = track.nodes if coasting is None else coasting
            track.unsupported(dt_us)
        self._gate.history(track.id).record(now_us, track.past())

    def _predict(self, track: Track, dt_us: int) -> FloatArray:
        """Warm-started nodes (M, 2)."""
        p = self._params
        if not (p.velocity_warm_start and track.hibernation.moving) or dt_us > p.longest_step_us:
            return track.nodes
        s = chain_coordinates(track.nodes, p.arc_length_parametrisation)
        kernel = mct_kernel(node_distances(track.nodes, s, p.geodesic_kernel), p.beta_px)
        return warm_start(track.nodes, track.velocity_px_s * (dt_us * 1e-6), kernel)

    def _register(
        self,
        track: Track,
        predicted: FloatArray,
        seen: Observations,
        now_us: int,
        dt_us: int,
        tau_us: float,
        clock: StageClock,
    ) -> bool:
        """Register, extend, and start anew where a trigger fires; False when there was nothing to register to."""
        p = self._params
        judged = track.in_image(self._geometry)
        points = seen.points
        if p.length_limit:
            points = within_reach(points, predicted, track.rest_length_px, track.diameter_px)
        result = register(predicted, points, track.sigma2_px2, p) if len(points) >= 3 else None
        clock.lap("registration")
        if result is None:
            return False
        before = track.nodes
        nodes = respaced(result.nodes)
        if nodes is not None and p.length_limit:
            nodes = within_length(nodes, predicted, track.rest_length_px, p.length_tolerance)
        if nodes is not None and p.endpoint_extension:
            nodes = extend_ends(nodes, points, track.diameter_px, track.rest_length_px, p)
        clock.lap("endpoint_extension")
        if nodes is None:
            return False
        track.nodes = nodes
        track.absorb(result, dt_us, judged)
        track.velocity_px_s = updated_velocity(
            track.velocity_px_s, (result.nodes - before) / (dt_us * 1e-6), track.visible, p.alpha_v
        )
        shift_px = float(np.hypot(*(result.nodes - predicted).T).mean())
        residual_px = float(result.support[judged].mean()) if judged.any() else 0.0
        if result.residual_px < _EXPLAINED_DIAMETERS * track.diameter_px:
            # Every observation lies on the curve: the nodes without any are at rest or hidden, not lost.
            residual_px = min(residual_px, result.residual_px)
        trigger = track.recovery.check(nodes, residual_px, shift_px, result.sigma2_px2)
        if trigger is not None and self._restart(track, now_us, tau_us, clock):
            track.recovery.count(trigger)
        return True

    def _restart(self, track: Track, now_us: int, tau_us: float, clock: StageClock) -> bool:
        """Re-initialise from the centreline in a wide region, else from the observed cloud along its principal axis.

        Returns False, with nothing changed, where neither shows most of the known length: at the onset of a motion only
        a part of the DLO causes events, the nodes elsewhere are far from every observation, and right.
        """
        p = self._params
        cell_px = cell_size_px(p, track.diameter_px)
        region = tube_around(track.nodes, p.prune_px, self._geometry, cell_px)
        line: FloatArray | None = None
        if region is not None:
            active = active_cells(self._surface.last_us, region, now_us, tau_us, track.diameter_px, p)
            seen = observe(
                refined(active, region, track.diameter_px, p), region, track.diameter_px, None, 0.0, p, clock
            )
            if seen is not None:
                in_image = float(track.in_image(self._geometry).mean())
                shortest = max(_RESTART_SHARE * in_image * track.rest_length_px, p.stuck_span_px)
                line = next(
                    (c for c in (seen.path, _along_principal_axis(seen.points)) if arc_length(c)[-1] >= shortest), None
                )
        if line is None:
            clock.lap("reinitialisation")
            return False
        line = resample(line[::-1] if runs_backwards(track.nodes, line) else line, p.nodes)
        if p.length_limit:
            line = within_length(line, track.nodes, track.rest_length_px, p.length_tolerance)
        track.start(line)
        track.reinitialised += 1
        self._gate.started(track.id, now_us)
        clock.lap("reinitialisation")
        return True

    # start without a frame

    def _search(self, now_us: int, tau_us: float, clock: StageClock) -> None:
        """Look for a long enough line over the whole sensor; start DLO 0 once it is there several times in a row."""
        p = self._params
        self._searches += 1
        if self._searches % _SEARCH_EVERY:
            return
        region = whole_sensor(self._geometry, max(cell_size_px(p, p.default_diameter_px), 2))
        active = active_cells(self._surface.last_us, region, now_us, tau_us, p.default_diameter_px, p)
        self._rho = active_ratio(active, region, self._geometry)
        clock.lap("recentness")
        mask = refined(active, region, p.default_diameter_px, p)
        clock.lap("morphology")
        seen = observe(mask, region, p.default_diameter_px, None, 0.0, p, clock)
        long_enough = seen is not None and arc_length(seen.path)[-1] >= p.start_length_diameters * p.default_diameter_px
        self._lines_in_a_row = self._lines_in_a_row + 1 if long_enough else 0
        if seen is None or self._lines_in_a_row < p.start_updates:
            return
        self._lines_in_a_row = 0
        track = self._new_track(_SELF_STARTED_ID, resample(seen.path, p.nodes), p.default_diameter_px)
        track.source = TrackSource.EVENT
        self._self_started = True
        self._gate.started(track.id, now_us)
        self._gate.history(track.id).record(now_us, track.past())


def _along_principal_axis(points: FloatArray) -> FloatArray:
    """A cloud (N, 2) in order along its principal axis (paper: "a PCA-ordered cloud of current observations")."""
    centred = points - points.mean(axis=0)
    _, axes = np.linalg.eigh(centred.T @ centred)
    return points[np.argsort(centred @ axes[:, 1], kind="stable")]
