"""Fusion's core: track updates and segmentations in; the state, requests for frames, and corrections out.

No clock, no bus: every time comes in with the data (event microseconds).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from motiondlo.frames.types import Appearance, EndKind, Instance, Segmentation
from motiondlo.fusion.alignment import FrameAlignment
from motiondlo.fusion.association import Match, associate, curve_distance, same_direction
from motiondlo.fusion.blending import blend_weight, blended
from motiondlo.fusion.handover import Handover
from motiondlo.fusion.history import TrackHistory
from motiondlo.fusion.judgement import Judge, Verdict
from motiondlo.fusion.mode import ModeMachine, RestChange
from motiondlo.fusion.params import FusionParams
from motiondlo.fusion.requests import RequestPlanner
from motiondlo.fusion.state import FrameRequest, FusedState, Mode, fused_dlo, unsupported
from motiondlo.rejects import RejectCounter, RejectReason
from motiondlo.tracking.types import Correction, CorrectionKind, TrackState, TrackUpdate

FloatArray = npt.NDArray[np.float64]

_BEFORE_ALL_US = -(1 << 60)
_LOSS_SHOWS_US = 30_000


@dataclass
class _Known:
    """What fusion remembers of a DLO besides its track."""

    state: TrackState | None = None
    appearance: Appearance | None = None
    ends: tuple[EndKind, EndKind] = (EndKind.UNKNOWN, EndKind.UNKNOWN)
    missed: int = 0


class FusionCore:
    """Knows the DLOs of the scene by id and keeps the tracker honest with the frame branch's shapes.

    Ids start at 0, grow, and are never used again. ``first_seq`` is the first correction's sequence number; a restarted
    process passes a larger one than it ever used, so that the tracker does not take its corrections for repeats.
    """

    def __init__(self, params: FusionParams, first_seq: int = 0) -> None:
        self._params = params
        self._mode = ModeMachine(params)
        self._requests = RequestPlanner(params)
        self._judge = Judge(params)
        self._history = TrackHistory(int(params.history_s * 1e6), int(params.history_step_ms * 1000))
        self._known: dict[int, _Known] = {}
        self._newborn: list[tuple[FloatArray, int]] = []
        self._next_id = 0
        self._seq = first_seq
        self._last_segmented_us: int | None = None
        self._due: list[Correction] = []
        self._retired: set[int] = set()
        self._handover = Handover()
        self._missed_us = _BEFORE_ALL_US
        self._now_us = -1
        self._waited_us = 0
        self._newest: FusedState | None = None
        self._paused = False
        self.degraded_reason = ""
        self.rejects = RejectCounter()
        self.alignment = FrameAlignment() if params.refine_homography else None

    # -- track updates ------------------------------------------------------------------------------------------------

    def on_track(self, update: TrackUpdate, whole: bool = True) -> FusedState:
        """Take the tracker's newest update; the state at its time. ``whole``: it rests on all events there were."""
        if not whole:
            self._missed_us = update.t_us
        before_us, self._now_us = self._now_us, update.t_us
        self._adopt(update, before_us)
        update = replace(update, tracks=self._handover.complete(update.tracks, update.t_us))
        change = self._mode.advance(update.t_us, update.tracks)
        for track in update.tracks:
            if track.moving and track.confidence >= self._params.overrule_confidence:
                self._judge.confirmed_by_events(track.id)
        self._history.add(update.t_us, update.tracks)
        if self.alignment is not None:
            self.alignment.saw(update.tracks)
        self._plan(update, change)
        mode = self._mode.scene
        self.degraded_reason = self._why_degraded(update)
        if self.degraded_reason and mode != Mode.BOOT:
            mode = Mode.DEGRADED
        dlos = tuple(fused_dlo(track) for track in update.tracks)
        self._newest = FusedState(update.t_us, update.t_events_us, mode, dlos)
        return self._newest

    def silent(self, silent_us: int) -> FusedState | None:
        """The last state again, when no track update has come for ``silent_us`` of the host's time.

        It is still for its own time, says DEGRADED, and its DLOs are supported by nothing. None before the first.
        """
        if self._newest is None:
            return None
        self.degraded_reason = f"nothing from the event camera or its tracker for {silent_us * 1e-6:.1f} s"
        return unsupported(self._newest, silent_us)

    def _adopt(self, update: TrackUpdate, before_us: int) -> None:
        """Learn the tracker's DLOs (also after a restart of fusion), and give back those that a new tracker lacks."""
        alive = {track.id for track in update.tracks}
        for track in update.tracks:
            if track.id in self._retired:
                continue  # still on its way when it was retired
            self._known.setdefault(track.id, _Known()).state = track
            self._next_id = max(self._next_id, track.id + 1)
        for dlo_id, known in self._known.items():
            if dlo_id in alive or known.state is None:
                continue
            self._due.append(self._restored(dlo_id, known, known.state, before_us))
            self._handover.add(known.state, before_us)
            known.state = None

    def _restored(self, dlo_id: int, known: _Known, state: TrackState, t_us: int) -> Correction:
        """``state``, held at ``t_us``, for a tracker that has lost it; it carries it on to its own time."""
        sigma = np.sqrt(np.maximum(state.cov_px2[:, 0] + state.cov_px2[:, 2], 1.0))
        kind = CorrectionKind.REINITIALISE
        correction = self._correction(dlo_id, t_us, kind, state.nodes, sigma, sigma, state.diameter_px, known)
        return replace(correction, not_before_us=-1, velocity_px_s=state.velocity_px_s if state.moving else None)

    def _plan(self, update: TrackUpdate, change: RestChange) -> None:
        self._requests.stirred(change.stirred)
        if self._mode.scene == Mode.BOOT:
            if self._requests.idle:
                self._requests.want("boot", update.t_us)
        elif change.rested:
            self._requests.want("came_to_rest", update.t_us, change.rested)
        elif self._mode.scene == Mode.STATIC and self._requests.idle and self._contested(update):
            # It lies elsewhere than its shape: who is right is better known soon.
            self._requests.want("contradicted", update.t_us, self._contested(update))
        elif self._mode.scene == Mode.STATIC and self._requests.idle:
            last = self._last_segmented_us
            if last is None or update.t_us - last >= self._params.refresh_static_s * 1e6:
                self._requests.want("refresh", update.t_us, frozenset(track.id for track in update.tracks))

    def _contested(self, update: TrackUpdate) -> frozenset[int]:
        return frozenset(track.id for track in update.tracks if self._judge.contested(track.id))

    def _why_degraded(self, update: TrackUpdate) -> str:
        if 0 <= update.t_us - self._missed_us < _LOSS_SHOWS_US:
            return "more events than this machine can follow: some are left out"
        if update.disturbed:
            return update.disturbed
        if self._paused:
            return "paused by command: shapes of frames are not used"
        if self._requests.failures_in_a_row >= self._params.degraded_after_failures:
            return f"segmentation failed {self._requests.failures_in_a_row} times in a row"
        weak = [track.id for track in update.tracks if track.confidence < self._params.degraded_confidence]
        return f"low confidence of DLO {', '.join(map(str, weak))}" if weak else ""

    def frame_request(self, waited_us: int = 0) -> FrameRequest | None:
        """The request for a segmentation to send now, if one is due; once returned, it counts as under way.

        Before the first track update this asks for the first frame that there is, and ``waited_us``, the host's time
        since the start, says when to ask again; after it, event time does.
        """
        self._waited_us = waited_us
        if self._paused:
            return None
        if self._now_us < 0 and self._requests.idle and not self._known:
            self._requests.want("boot", -1)
        return self._requests.due(self._planning_us)

    def awaits(self, request: FrameRequest) -> bool:
        """Whether the answer to ``request`` is still waited for: it was not cancelled, answered or given up."""
        sent = self._requests.under_way
        return sent is not None and sent.number == request.number

    # -- commands -----------------------------------------------------------------------------------------------------

    def reset(self) -> tuple[Correction, ...]:
        """Forget all DLOs and begin with the next frame; their ids are not used again. Corrections for the tracker."""
        self._due, self._newborn = [], []
        self._handover, self._judge = Handover(), Judge(self._params)
        retired = tuple(self._retire(dlo_id, max(self._now_us, 0)) for dlo_id in tuple(self._known))
        self._requests.want("reset", self._now_us)
        return retired

    def pause(self, paused: bool) -> None:
        """Take the frame branch out, or in again: no frame is asked for, no shape is used; events go on alone."""
        self._paused = paused

    @property
    def paused(self) -> bool:
        """Whether the frame branch is out."""
        return self._paused

    def withdrawn(self) -> tuple[int, ...]:
        """Numbers of requests under way that nobody needs any more, because their DLOs moved again; drained."""
        return self._requests.withdrawn()

    @property
    def cancelled(self) -> int:
        """Requests that were cancelled because their DLOs moved again."""
        return self._requests.cancelled

    @property
    def _planning_us(self) -> int:
        """Event time, or before there is one the time waited, as a time before all event times."""
        return self._now_us if self._now_us >= 0 else _BEFORE_ALL_US + self._waited_us

    def corrections_due(self) -> tuple[Correction, ...]:
        """Corrections that a track update gave rise to (a tracker that was restarted gets its DLOs back); drained."""
        due, self._due = tuple(self._due), []
        return due

    # -- segmentations ------------------------------------------------------------------------------------------------

    def on_segmentation(self, seg: Segmentation, now_us: int, number: int | None = None) -> tuple[Correction, ...]:
        """Take the segmentation of the frame of ``seg.t_us``, arriving at ``now_us``; corrections for the tracker.

        number: of the request that it answers; None: the one under way.
        """
        usable = [i for i in seg.instances if i.nodes_event is not None and len(i.nodes_event) >= 2]
        self._requests.arrived(not seg.failure and bool(usable), self._planning_us, number)
        if seg.failure or not usable or self._paused:
            return ()
        self._last_segmented_us = max(seg.t_us, now_us)
        given = [np.asarray(i.nodes_event, dtype=np.float64) for i in usable]
        curves = given if self.alignment is None else [self.alignment.aligned(curve) for curve in given]
        tracks = self._history.at(seg.t_us)
        if tracks is None and self._known:
            self.rejects.count(RejectReason.TOO_OLD, n=len(usable))
            return ()  # older than what is remembered: nothing to compare it with
        tracks = tuple(track for track in tracks or () if track.id not in self._retired)
        corrections: list[Correction] = []
        first = not self._known
        looks = {dlo_id: known.appearance for dlo_id, known in self._known.items()}
        matches = {m.instance: m for m in associate(usable, curves, tracks, looks, self._params.match_max_px)}
        contested = len(tracks) > len(matches)
        for k, (instance, curve) in enumerate(zip(usable, curves, strict=True)):
            match = matches.get(k)
            if match is not None:
                if self.alignment is not None:
                    self.alignment.learn(given[k], instance.sigma_px, tracks[match.track])
                correction = self._matched(instance, curve, match, tracks[match.track], seg.t_us, now_us)
                if correction is not None:
                    corrections.append(correction)
            elif instance.score >= self._params.birth_score and (first or self._is_confirmed(curve, contested)):
                corrections.append(self._born(instance, curve, seg.t_us))
            else:
                self.rejects.count(RejectReason.UNCONFIRMED)
        self._newborn = [(curve, self._seen_before(curve) + 1) for k, curve in enumerate(curves) if k not in matches]
        corrections += self._deaths({tracks[m.track].id for m in matches.values()}, tracks, now_us)
        return tuple(corrections)

    def _matched(
        self, instance: Instance, curve: FloatArray, match: Match, track: TrackState, t_us: int, now_us: int
    ) -> Correction | None:
        known = self._known.setdefault(track.id, _Known())
        known.missed = 0
        forward = same_direction(curve, track.nodes)
        normal = np.hypot(instance.sigma_px, self._params.homography_sigma_px)
        ends, appearance = instance.ends, instance.appearance
        if not forward:
            curve, normal, ends, appearance = curve[::-1].copy(), normal[::-1].copy(), (ends[1], ends[0]), None
        if self._params.method == "blend":
            return self._blended(instance, curve, track, t_us, now_us)
        verdict = self._judge.judge(curve, normal, match.distance_px, track, t_us)
        if verdict is Verdict.REFUSE:
            self.rejects.count(RejectReason.OUTVOTED)
            return None
        if verdict is Verdict.ABSORB:
            ends = self._judge.credible_ends(ends, curve, track)
            if appearance is not None and ends == instance.ends:
                known.appearance, known.ends = appearance, ends
        return self._correction(
            track.id,
            t_us,
            CorrectionKind.BLEND if verdict is Verdict.ABSORB else CorrectionKind.REINITIALISE,
            curve,
            normal,
            self._tangent_sigma(ends, len(curve)),
            instance.diameter_px,
            _Known(appearance=appearance, ends=ends),
        )

    def _blended(
        self, instance: Instance, curve: FloatArray, then: TrackState, t_us: int, now_us: int
    ) -> Correction | None:
        known = self._known[then.id]
        now = known.state
        if now is None or len(now.nodes) != len(then.nodes):
            return None
        weight = blend_weight(instance.score, now.confidence, now_us - t_us, self._params.blend_memory_ms)
        nodes = blended(curve, then, now, weight)
        normal = np.full(len(nodes), self._params.homography_sigma_px)
        tangent = self._tangent_sigma(known.ends, len(nodes))
        return self._correction(
            then.id, now_us, CorrectionKind.REINITIALISE, nodes, normal, tangent, now.diameter_px, known
        )

    def _seen_before(self, curve: FloatArray) -> int:
        """In how many segmentations in a row, up to the last one, this curve was already there without a track."""
        near = [n for other, n in self._newborn if curve_distance(curve, other) <= self._params.match_max_px / 4]
        return max(near, default=0)

    def _is_confirmed(self, curve: FloatArray, contested: bool) -> bool:
        """Seen often enough; while a known DLO is missing (``contested``) it may be that one, segmented wrongly."""
        needed = self._params.birth_confirmations + (self._params.overrule_votes if contested else 0)
        return self._seen_before(curve) + 1 >= needed

    def _born(self, instance: Instance, curve: FloatArray, t_us: int) -> Correction:
        dlo_id, self._next_id = self._next_id, self._next_id + 1
        known = _Known(appearance=instance.appearance, ends=instance.ends)
        self._known[dlo_id] = known
        normal = np.hypot(instance.sigma_px, self._params.homography_sigma_px)
        tangent = self._tangent_sigma(instance.ends, len(curve))
        return self._correction(
            dlo_id, t_us, CorrectionKind.REINITIALISE, curve, normal, tangent, instance.diameter_px, known
        )

    def _deaths(self, seen: set[int], tracks: tuple[TrackState, ...], now_us: int) -> list[Correction]:
        retired = []
        for track in tracks:
            known = self._known.get(track.id)
            if track.id in seen or known is None:
                continue
            known.missed += 1
            if known.missed >= self._params.death_confirmations and track.confidence < self._params.degraded_confidence:
                retired.append(self._retire(track.id, now_us))
        return retired

    def _retire(self, dlo_id: int, now_us: int) -> Correction:
        del self._known[dlo_id]
        self._retired.add(dlo_id)
        none = np.zeros(0)
        return self._correction(dlo_id, now_us, CorrectionKind.RETIRE, np.zeros((0, 2)), none, none, 0.0, _Known())

    def _tangent_sigma(self, ends: tuple[EndKind, EndKind], count: int) -> FloatArray:
        """(M,) px: a seen end fixes the curve along itself; without one it may slide by several diameters."""
        fixed = any(end in (EndKind.TIP, EndKind.HELD) for end in ends)
        return np.full(count, self._params.tangent_sigma_px * (1.0 if fixed else 10.0))

    def _correction(
        self,
        dlo_id: int,
        t_us: int,
        kind: CorrectionKind,
        nodes: FloatArray,
        sigma_normal_px: FloatArray,
        sigma_tangent_px: FloatArray,
        diameter_px: float,
        known: _Known,
    ) -> Correction:
        self._seq += 1
        return Correction(
            seq=self._seq,
            id=dlo_id,
            t_us=t_us,
            kind=kind,
            nodes=nodes,
            sigma_normal_px=sigma_normal_px,
            sigma_tangent_px=sigma_tangent_px,
            diameter_px=diameter_px,
            ends=known.ends,
            appearance=known.appearance,
            not_before_us=-1 if self._now_us < 0 else self._now_us + int(self._params.lead_ms * 1000),
        )
