"""What a tracker's confidence is worth: whether it is lower where the estimate is wrong."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.stats import rankdata

FloatArray = npt.NDArray[np.float64]

WRONG_MM = 2.0
_BINS = 10


@dataclass(frozen=True)
class Bin:
    """Estimates with ``low <= confidence < high`` (the last bin includes 1)."""

    low: float
    high: float
    count: int
    wrong_share: float
    error_mm: float


@dataclass(frozen=True)
class Calibration:
    """An estimate is wrong when its error exceeds 2 mm."""

    estimates: int
    wrong: int
    auc: float | None
    """Area under the ROC curve for "wrong" from low confidence: 1 tells all wrong ones, 0.5 is chance; None where all
    estimates are right, or all wrong."""
    bins: tuple[Bin, ...]
    """Those with estimates, from the lowest."""

    def summary(self) -> str:
        """One line."""
        share = 100 * self.wrong / self.estimates
        auc = "not defined" if self.auc is None else f"{self.auc:.3f}"
        return (
            f"confidence: {self.wrong} of {self.estimates} estimates ({share:.1f} %) are off by more than {WRONG_MM:g} "
            f"mm; area under the ROC curve of telling them: {auc}"
        )

    def as_json(self) -> dict[str, Any]:
        """The ``confidence`` entry of ``eval --json``."""
        return {
            "wrong_above_mm": WRONG_MM,
            "estimates": self.estimates,
            "wrong": self.wrong,
            "auc": None if self.auc is None else round(self.auc, 4),
            "calibration": [
                {
                    "confidence": [row.low, row.high],
                    "estimates": row.count,
                    "wrong_share": round(row.wrong_share, 4),
                    "error_mm": round(row.error_mm, 4),
                }
                for row in self.bins
            ],
        }


def calibrate(confidence: FloatArray, error_mm: FloatArray) -> Calibration | None:
    """Judge ``confidence`` (R,) by ``error_mm`` (R,); rows without either are left out, None where none is left."""
    known = np.isfinite(confidence) & np.isfinite(error_mm)
    confidence, error_mm = confidence[known], error_mm[known]
    if not len(confidence):
        return None
    wrong = error_mm > WRONG_MM
    index = np.clip((confidence * _BINS).astype(int), 0, _BINS - 1)
    bins = tuple(
        Bin(
            k / _BINS,
            (k + 1) / _BINS,
            int((index == k).sum()),
            float(wrong[index == k].mean()),
            float(error_mm[index == k].mean()),
        )
        for k in np.unique(index).tolist()
    )
    return Calibration(len(wrong), int(wrong.sum()), area_under_roc(wrong, -confidence), bins)


def area_under_roc(positive: npt.NDArray[np.bool_], score: FloatArray) -> float | None:
    """Chance that a positive row (R,) has the higher score, ties counted half; None without rows of either kind."""
    n = int(positive.sum())
    rest = len(positive) - n
    if not n or not rest:
        return None
    return float((rankdata(score)[positive].sum() - n * (n + 1) / 2) / (n * rest))
