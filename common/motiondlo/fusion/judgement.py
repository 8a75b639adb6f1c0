"""What a segmented shape that was matched to a track is worth: absorbed, taken for a new start, or outvoted.

The events have a say as long as they support the track. A shape that contradicts such a track is a mistake of the
segmenter more often than one of the tracker; only several in a row that agree with one another, with no support from
events in between, overrule it, and fewer where the track's own confidence is not high. One that contradicts a track
that is as good as lost starts it anew at once. Shapes of nearly the same time see the same picture: they are one vote.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import StrEnum

import numpy as np
import numpy.typing as npt

from motiondlo.frames.types import EndKind
from motiondlo.fusion.association import curve_distance
from motiondlo.fusion.params import FusionParams
from motiondlo.geometry.curve import arc_length, distance_to_curve, left_normals, tangents
from motiondlo.tracking.types import TrackState

FloatArray = npt.NDArray[np.float64]


class Verdict(StrEnum):
    """What is done with a shape."""

    ABSORB = "absorb"
    START_ANEW = "start_anew"
    REFUSE = "refuse"


def normal_sigma_px(track: TrackState) -> FloatArray:
    """(M,) standard deviation of a track's nodes across it."""
    normals = left_normals(tangents(track.nodes))
    xx, xy, yy = track.cov_px2.T
    variance = normals[:, 0] ** 2 * xx + 2 * normals[:, 0] * normals[:, 1] * xy + normals[:, 1] ** 2 * yy
    return np.asarray(np.sqrt(np.maximum(variance, 0.0)))


def mahalanobis(curve: FloatArray, sigma_px: FloatArray, track: TrackState) -> float:
    """How far a curve (M, 2), sigma (M,), lies beside a track, in standard deviations: median over the nearer 80 %.

    Taken from the track's nodes or from the curve's, whichever fits better: one may be a part of the other.
    """
    total = float(np.hypot(np.median(sigma_px), np.median(normal_sigma_px(track))))
    far = []
    for a, b in ((track.nodes, curve), (curve, track.nodes)):
        d = np.sort(distance_to_curve(a, b))
        far.append(float(np.median(d[: max(1, round(0.8 * len(d)))])))
    return min(far) / max(total, 1e-6)


@dataclass
class _Dissent:
    """Shapes in a row that contradict a track and agree with one another."""

    curve: FloatArray | None = None
    count: int = 0
    counted_us: int = 0
    """Time of the frame that gave the last vote."""


@dataclass
class Judge:
    """Remembers, per DLO, the shapes that contradicted its track."""

    params: FusionParams
    _dissent: dict[int, _Dissent] = field(default_factory=dict)

    def confirmed_by_events(self, dlo_id: int) -> None:
        """The DLO moves and its events support the track: earlier dissent was of another situation."""
        self._dissent.pop(dlo_id, None)

    def judge(
        self, curve: FloatArray, sigma_px: FloatArray, distance_px: float, track: TrackState, t_us: int
    ) -> Verdict:
        """Judge a shape (M, 2) with its sigma (M,), matched to ``track`` at ``t_us``, the time of its frame."""
        p = self.params
        far = mahalanobis(curve, sigma_px, track)
        if distance_px <= p.reinitialise_min_px and far <= p.gate_sigma:
            self._dissent.pop(track.id, None)
            return Verdict.ABSORB
        if distance_px <= p.reinitialise_min_px:
            return Verdict.REFUSE  # beside the track by more than both say, by less than a new start is worth
        if track.confidence < p.degraded_confidence:
            self._dissent.pop(track.id, None)
            return Verdict.START_ANEW
        dissent = self._dissent.setdefault(track.id, _Dissent())
        agrees = dissent.curve is not None and curve_distance(curve, dissent.curve) <= p.reinitialise_min_px
        if not agrees:
            dissent.count, dissent.counted_us = 1, t_us
        elif t_us - dissent.counted_us >= p.vote_spacing_ms * 1000:
            dissent.count, dissent.counted_us = dissent.count + 1, t_us
        dissent.curve = curve
        votes = p.overrule_votes if track.confidence >= p.overrule_confidence else (p.overrule_votes + 1) // 2
        if dissent.count < votes:
            return Verdict.REFUSE
        del self._dissent[track.id]
        return Verdict.START_ANEW

    def contested(self, dlo_id: int) -> bool:
        """Whether shapes contradict this DLO's track, and more of them will decide."""
        return dlo_id in self._dissent

    def credible_ends(
        self, ends: tuple[EndKind, EndKind], curve: FloatArray, track: TrackState
    ) -> tuple[EndKind, EndKind]:
        """The ends of a shape (M, 2), without those tips that its track contradicts.

        A DLO cannot stretch: a shape much longer than it is two DLOs in one line, a much shorter one is a part; then a
        tip that is not where the track has one is where the segmenter stopped.
        """
        length, held = float(arc_length(curve)[-1]), float(arc_length(track.nodes)[-1])
        if abs(length - held) <= self.params.length_tolerance * held:
            return ends
        near = 2.0 * max(track.diameter_px, self.params.tangent_sigma_px)
        kept = [
            kind if kind is not EndKind.TIP or np.hypot(*(curve[k] - track.nodes[k])) <= near else EndKind.HIDDEN
            for k, kind in zip((0, -1), ends, strict=True)
        ]
        return kept[0], kept[1]
