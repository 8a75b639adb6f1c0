"""Evaluate tracks against ground truth: one verdict per true DLO, and the document of ``motiondlo eval --json``."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from motiondlo.offline.confidence import Calibration, calibrate
from motiondlo.offline.ground_truth import GroundTruth
from motiondlo.offline.matching import count_switches, distances_on_grid, fresh_on_grid, match_ids
from motiondlo.offline.metrics import Errors, errors_of, judged_grid, judged_seconds, lost_fraction
from motiondlo.offline.tracks import Tracks

FloatArray = npt.NDArray[np.float64]

_SPEED_BANDS_MM_S = {"below_500": (0.0, 500.0), "500_to_1000": (500.0, 1000.0), "above_1000": (1000.0, np.inf)}


@dataclass(frozen=True)
class Summary:
    """Mean, median and 95th percentile over the estimates; None where there is none."""

    mean: float | None
    median: float | None
    p95: float | None

    @staticmethod
    def of(values: FloatArray) -> Summary:
        """Summarise the finite values of (R,)."""
        values = values[np.isfinite(values)]
        if not len(values):
            return Summary(None, None, None)
        return Summary(float(values.mean()), float(np.median(values)), float(np.percentile(values, 95)))

    def as_json(self) -> dict[str, float | None]:
        """Rounded to 0.1 um."""
        return {"mean": _rounded(self.mean), "median": _rounded(self.median), "p95": _rounded(self.p95)}


@dataclass(frozen=True)
class Verdict:
    """How one true DLO was tracked."""

    name: str
    dlo: int
    """Index in the ground truth."""
    moved: bool
    id: int | None
    """The matched id; None where no id was left for this DLO, which then is lost all the time."""
    ptc_mm: Summary
    e_mm: Summary
    cov_mm: Summary
    ptc_by_speed_mm: dict[str, float | None]
    lost_fraction: float
    id_switches: int
    lag_ms: float | None
    rate_hz: float
    nees: float | None
    nees_tangent: float | None
    within_sigma: tuple[float | None, ...]
    """Shares of the normal errors below 1, 2 and 3 sigma."""
    errors: Errors | None

    def as_json(self) -> dict[str, Any]:
        """The entry of ``eval --json``."""
        return {
            "name": self.name,
            "id": self.id,
            "ptc_mm": self.ptc_mm.as_json(),
            "e_mm": _rounded(self.e_mm.mean),
            "cov_mm": _rounded(self.cov_mm.mean),
            "lost_fraction": _rounded(self.lost_fraction),
            "id_switches": self.id_switches,
            "lag_ms": _rounded(self.lag_ms),
            "rate_hz": round(self.rate_hz, 2),
            "nees": _rounded(self.nees),
            "nees_tangent": _rounded(self.nees_tangent),
            "within_sigma": [_rounded(share) for share in self.within_sigma],
            "e_detail_mm": self.e_mm.as_json(),
            "cov_detail_mm": self.cov_mm.as_json(),
            "ptc_by_speed_mm": {band: _rounded(value) for band, value in self.ptc_by_speed_mm.items()},
        }


@dataclass(frozen=True)
class Evaluation:
    """All verdicts, in the order of the ground truth."""

    verdicts: tuple[Verdict, ...]
    unmatched_ids: tuple[int, ...]
    """Ids that no true DLO was left for."""
    calibration: Calibration | None
    """What the confidence of the DLOs that move is worth; None where the tracks have none."""

    @property
    def moved(self) -> tuple[Verdict, ...]:
        """DLOs that move at some time."""
        return tuple(verdict for verdict in self.verdicts if verdict.moved)

    @property
    def static(self) -> tuple[Verdict, ...]:
        """DLOs that never move."""
        return tuple(verdict for verdict in self.verdicts if not verdict.moved)

    def as_json(self) -> dict[str, Any]:
        """The document of ``eval --json``."""
        return {
            "moved": [verdict.as_json() for verdict in self.moved],
            "static": [verdict.as_json() for verdict in self.static],
            "unmatched_ids": list(self.unmatched_ids),
            "confidence": None if self.calibration is None else self.calibration.as_json(),
        }


def evaluate(tracks: Tracks, truth: GroundTruth) -> Evaluation:
    """Judge every true DLO by the id that was matched to it."""
    matched = match_ids(tracks, truth)
    verdicts = tuple(_verdict(tracks, truth, dlo, matched.get(dlo)) for dlo in range(truth.count))
    left_over = sorted(set(tracks.known_ids()) - set(matched.values()))
    return Evaluation(verdicts, tuple(left_over), _calibration(tracks, verdicts))


def _calibration(tracks: Tracks, verdicts: tuple[Verdict, ...]) -> Calibration | None:
    confidence, error_mm = [], []
    for verdict in verdicts:
        if verdict.moved and verdict.errors is not None:
            use = verdict.errors.judged
            confidence.append(tracks.confidence[verdict.errors.rows[use]].astype(np.float64))
            # Beside the true curve, or not all of it: the worse of the two.
            error_mm.append(np.fmax(verdict.errors.ptc_mm[use], verdict.errors.cov_mm[use]))
    if not confidence:
        return None
    return calibrate(np.concatenate(confidence), np.concatenate(error_mm))


def _verdict(tracks: Tracks, truth: GroundTruth, dlo: int, track_id: int | None) -> Verdict:
    grid_us = judged_grid(truth, dlo)
    seconds = judged_seconds(truth, dlo)
    nothing = np.empty(0)
    if track_id is None:
        errors, ptc_mm, e_mm, cov_mm, nees, slip, speed_mm_s, switches = None, *([nothing] * 6), 0
        within = np.empty((0, 3))
    else:
        errors = errors_of(tracks, track_id, truth, dlo)
        use = errors.judged
        ptc_mm, e_mm, cov_mm = errors.ptc_mm[use], errors.e_mm[use], errors.cov_mm[use]
        nees, slip, within = errors.nees[use], errors.nees_tangent[use], errors.within[use]
        speed_mm_s = errors.speed_mm_s[use]
        switches = count_switches(
            distances_on_grid(tracks, truth, dlo, grid_us),
            fresh_on_grid(tracks, grid_us),
            tracks.known_ids().index(track_id),
        )
    return Verdict(
        name=truth.names[dlo],
        dlo=dlo,
        moved=bool(truth.moved[dlo]),
        id=track_id,
        ptc_mm=Summary.of(ptc_mm),
        e_mm=Summary.of(e_mm),
        cov_mm=Summary.of(cov_mm),
        ptc_by_speed_mm={
            band: Summary.of(ptc_mm[(speed_mm_s >= low) & (speed_mm_s < high)]).mean
            for band, (low, high) in _SPEED_BANDS_MM_S.items()
        },
        lost_fraction=lost_fraction(errors, grid_us),
        id_switches=switches,
        lag_ms=None if errors is None else errors.lag_ms,
        rate_hz=0.0 if seconds == 0.0 else len(ptc_mm) / seconds,
        nees=Summary.of(nees).mean,
        nees_tangent=Summary.of(slip).mean,
        within_sigma=tuple(Summary.of(within[:, k]).mean for k in range(3)),
        errors=errors,
    )


def _rounded(value: float | None) -> float | None:
    return None if value is None else round(value, 4)
