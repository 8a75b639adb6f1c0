"""One DLO: a filter over its control nodes, stations along it, its ends, its texture; one step per event batch."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from motiondlo.events.types import SensorGeometry
from motiondlo.frames.types import EndKind
from motiondlo.tracking.chain import near_kernels
from motiondlo.tracking.chain.end_view import PatchScratch
from motiondlo.tracking.chain.ends import End
from motiondlo.tracking.chain.filter_state import ChainFilter
from motiondlo.tracking.chain.layout import lay_out
from motiondlo.tracking.chain.params import ChainParams
from motiondlo.tracking.chain.report import Judgement, Report, inside_image
from motiondlo.tracking.chain.spline import weights
from motiondlo.tracking.chain.stations import Stations, Surface
from motiondlo.tracking.chain.texture import PAD_PX, Texture, find_texture
from motiondlo.tracking.chain.texture_kernels import measure_texture
from motiondlo.tracking.types import Correction, TrackSource, TrackState

FloatArray = npt.NDArray[np.float64]

_LEAST_DIAMETER_PX = 4.0
_RESTING_PX_MS = 0.3
_SLOW_PX_MS = 1.0
_SLEEP_MS = 40.0
# Silence along the whole DLO after which even a fast one has stopped.
_STOP_MS = 4.0
_LONG_AGO_MS = 1000.0
_SILENT_SIGMA = 0.15
_FROZEN_SIGMA = 0.1
_SHADOW_PX = 24.0
# A gripper's arm goes on behind it: this far, and so wide.
_ARM_PX = 300.0
_ARM_HALF_PX = 60.0
_COVER_STEP_PX = 1.5
_TIP_PX_MS = 0.4


class Chain:
    """A tracked DLO."""

    def __init__(self, correction: Correction, params: ChainParams, geometry: SensorGeometry) -> None:
        self.id = correction.id
        self.params = params
        self.geometry = geometry
        self.diameter_px = max(correction.diameter_px, _LEAST_DIAMETER_PX)
        radius = 0.5 * self.diameter_px
        look = correction.appearance
        layout = lay_out(correction, params)
        self.filter = ChainFilter(layout, correction, params)
        self.stations = Stations(layout, correction, radius, params, geometry)
        self.u_first, self.u_last = float(layout.u(0.0)), float(layout.u(layout.length_px))
        self.ends = tuple(
            End(correction.ends[k], k, look, layout.length_px, radius, (self.u_first, self.u_last)[k]) for k in (0, 1)
        )
        for end in self.ends:
            end.prime(self.filter)
        self._centre = np.array([geometry.width_px / 2.0, geometry.height_px / 2.0])
        nodes = np.asarray(correction.nodes, dtype=np.float64)
        self._covered = [self._first_cover(nodes), self._first_cover(nodes[::-1])]
        self.texture = find_texture(look, layout.length_px, radius, params.texture_patches)
        if self.texture is not None:
            self._texture_at = weights(layout.u(self.texture.s_px), layout.K)
            self.texture_shifts = np.full(len(self.texture.s_px), np.nan)
        self.texture_used = 0
        bias = params.bias_sigma * self.diameter_px
        self._report = Report(params.output_nodes, layout.K, bias, params.bias_along_sigma * self.diameter_px)
        self._set_extent()
        self.stations.start(self.filter)
        self.judgement = Judgement()
        self._scratch = PatchScratch()
        self.still_ms = _LONG_AGO_MS
        """How long it has been at rest; 0 while it moves."""
        self._silent_ms = 0.0
        self.asleep = False
        self.fit_px = 0.0
        self.reinitialised = 0
        self.t_corrected_us = -1
        self._state: TrackState | None = None

    # between updates

    def touch(self) -> None:
        """The state was changed from outside an update: report it anew."""
        self._state = None
        self.stations.place(self.filter)

    @property
    def moving(self) -> bool:
        """Whether it was not found at rest in the last update."""
        return self.still_ms == 0.0

    @property
    def passes_others(self) -> bool:
        """Whether it moves so that bystanders must ignore events about it."""
        return not self.asleep and self.moving and self.stations.speed() > _RESTING_PX_MS

    @property
    def active_px(self) -> float:
        """Area of the sensor that its motion covers, px^2."""
        return float(self.stations.use.sum()) * self.params.station_px * self.diameter_px if self.moving else 0.0

    def mark(self, grid: npt.NDArray[np.uint32], bit: int) -> None:
        """Claim the tiles of the DLO, of its shadow and of what holds it."""
        near_kernels.mark(grid, self.stations.g, 0.5 * self.diameter_px + _SHADOW_PX, bit)
        for end in self.ends:
            if end.kind is EndKind.HELD:
                v = end.view(self.filter)
                reach = np.arange(0.0, _ARM_PX, 24.0)
                near_kernels.mark(grid, v.point + reach[:, None] * v.outward, _ARM_HALF_PX, bit)

    # one update

    def step(self, last: Surface, t_us: int, dt_ms: float) -> None:
        """Advance by ``dt_ms`` to ``t_us`` with the events on the surface ``last`` (2, H, W)."""
        if self.asleep:
            if self.stations.activity(last, t_us) < self.params.wake_events:
                return
            self.asleep = False
        self._state = None
        f, stations = self.filter, self.stations
        speed = stations.speed()
        f.predict(dt_ms, speed, resting=not self.moving)
        stations.measure(f, last, t_us, dt_ms, resting=speed < _RESTING_PX_MS)
        f.adapt(dt_ms, stations.nis, max(end.surprise for end in self.ends))
        self._rest(dt_ms, speed)
        self._follow_into_view(last, t_us)
        for end in self.ends:
            end.measure(f, last, t_us, dt_ms, self._centre, self._scratch)
        if self.texture is not None:
            self._measure_texture(self.texture, last, t_us, dt_ms)
        if self.moving and self.texture_used == 0 and not any(end.measured for end in self.ends):
            f.slide(self.params.slide_share * speed * dt_ms, dt_ms)
        self._renew_covers()
        f.constrain(dt_ms)
        if not f.keep_sound():
            self._silent_ms = 0.0
        stations.place(f)
        stations.keep_velocities()
        offsets = stations.out[stations.use, 0]
        self.fit_px = float(np.sqrt(np.mean(offsets**2))) if len(offsets) else 0.0
        self.judgement.update(stations, dt_ms, self.moving, f.boost, max(end.unmatched_ms for end in self.ends))

    def _rest(self, dt_ms: float, speed: float) -> None:
        """No events are a measurement: of parts known to be visible, and of the whole."""
        f, stations = self.filter, self.stations
        stations.count_support(dt_ms)
        stations.hold(f, stations.silent(), _SILENT_SIGMA**2 / dt_ms, both=False)
        silent = stations.all_silent()
        self._silent_ms = self._silent_ms + dt_ms if silent else 0.0
        if silent and speed >= _SLOW_PX_MS and self._silent_ms >= _STOP_MS:
            # It stopped where its last events were.
            f.stop(self._silent_ms)
            speed = 0.0
        if not silent or speed >= _SLOW_PX_MS:
            self.still_ms = 0.0
            return
        stations.hold(f, np.ones(stations.count, np.bool_), _FROZEN_SIGMA**2 / dt_ms, both=True)
        self.still_ms += dt_ms
        self.asleep = self.still_ms >= _SLEEP_MS

    def _measure_texture(self, texture: Texture, last: Surface, t_us: int, dt_ms: float) -> None:
        p, f, scratch = self.params, self.filter, self._scratch
        j0, w, w1, w2 = self._texture_at
        self.texture_used = measure_texture(
            last, t_us, dt_ms, p.latency_us * 1e-3, p.window_px, p.window_max_ms, f.x, f.P, f.K, j0, w, w1, w2,
            texture.tables, PAD_PX, texture.half_length_px, texture.half_width_px, p.texture_sigma_px, f.row,
            scratch.a, scratch.d, scratch.p, scratch.age, scratch.score, scratch.out, self.texture_shifts,
        )  # fmt: skip

    def _follow_into_view(self, last: Surface, t_us: int) -> None:
        """Where the DLO came in from beyond the image: what is supported exists, and at some place it ends."""
        stations = self.stations
        for k, end in enumerate(self.ends):
            if end.kind not in (EndKind.BORDER, EndKind.HIDDEN):
                continue
            step = 1 if k == 1 else -1
            edge = known = self.u_last if k == 1 else self.u_first
            for s in np.flatnonzero((stations.u - edge) * step > 0.0)[::step]:
                if not (stations.inside[s] and stations.use[s] and stations.nis[s] < 9.0):
                    break
                edge = float(stations.u[s])
            if edge != known:
                self._set_edge(k, edge)
            if np.hypot(*stations.g[-k, 4:6]) > _TIP_PX_MS and end.look_for_tip(
                edge, self.filter, last, t_us, self._scratch
            ):
                self._set_edge(k, end.u)
                stations.exists &= (stations.u - end.u) * step < 0.0

    # extent

    def _set_edge(self, k: int, u: float) -> None:
        if k == 1:
            self.u_last = u
        else:
            self.u_first = u
        self._set_extent()

    def _set_extent(self) -> None:
        beyond = [
            self._covered[end.which] / self.filter.span_px if end.kind is EndKind.HELD else 0.0 for end in self.ends
        ]
        self._report.set_extent(self.u_first - beyond[0], self.u_last + beyond[1])

    def _first_cover(self, nodes: FloatArray) -> float:
        """How far the DLO goes on, unseen, past the first of ``nodes`` if that is held.

        A gripper is higher than the DLO and so is shifted outwards in the image, over the DLO or away from it.
        """
        p = self.params
        inward = nodes[min(5, len(nodes) - 1)] - nodes[0]
        over = float((nodes[0] - self._centre) @ inward) / max(float(np.hypot(*inward)), 1e-9)
        return self._cover(p.height_ratio * over)

    def _cover(self, shift_px: float) -> float:
        p = self.params
        return float(np.clip(p.held_cover * self.diameter_px + shift_px, 0.0, p.held_cover_max_px))

    def _renew_covers(self) -> None:
        """A gripper that was measured tells by its shift against the frame how much of the DLO it covered there."""
        changed = False
        for end in self.ends:
            if end.kind is not EndKind.HELD or not end.sure:
                continue
            e = self.filter.extras(end.which)
            cover = self._cover(float(self.filter.x[e] / (1.0 + self.filter.x[e + 2])))
            if abs(cover - self._covered[end.which]) > _COVER_STEP_PX:
                self._covered[end.which] = cover
                changed = True
        if changed:
            self._set_extent()

    # report

    def state(self) -> TrackState:
        """The DLO as it is reported; the same object while it sleeps."""
        if self._state is None:
            nodes, velocity, cov = self._report.take(self.filter)
            seen = self.stations.supported(self._report.u) & inside_image(nodes, self.geometry)
            observed = bool(self.stations.use.any()) or not self.moving
            self._state = TrackState(
                id=self.id,
                nodes=nodes,
                velocity_px_s=velocity,
                cov_px2=cov,
                visible=seen.astype(np.uint8),
                diameter_px=self.diameter_px,
                confidence=self.judgement.confidence,
                moving=self.moving,
                source=TrackSource.EVENT if observed else TrackSource.PREDICTED,
                t_corrected_us=self.t_corrected_us,
                fit_px=self.fit_px,
                reinitialised=self.reinitialised,
            )
        return self._state
