"""How good a calibrated homography is: residuals, and what to expect of it over the whole event image."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from motiondlo.calibration.point_pairs import PointPairs, check_point_pairs, covered_share
from motiondlo.geometry.homography_fit import HomographyFit, expected_error_px, fit_homography

FloatArray = npt.NDArray[np.float64]


@dataclass(frozen=True)
class HomographyReport:
    """Figures for a person; distances in px, of the pairs that were used."""

    pairs: int
    inliers: int
    mean_px: float
    """Symmetric transfer error."""
    p95_px: float
    largest_px: float
    sigma_px: float
    """Noise of one coordinate of one point, as the residuals show it."""
    heavy_tailed: bool
    covered_share: float
    expected_px: float
    """Expected error of the map itself: mean over the event image."""
    expected_worst_px: float
    """The same at its worst place."""
    warnings: tuple[str, ...]

    def as_dict(self) -> dict[str, Any]:
        """For JSON."""
        return asdict(self) | {"warnings": list(self.warnings)}


def calibrate_homography(
    pairs: PointPairs, event_size_px: tuple[int, int], max_error_px: float = 5.0
) -> tuple[HomographyFit, HomographyReport]:
    """Check, fit, judge. Raises CalibrationError for degenerate pairs, or where no four of them agree."""
    warnings = check_point_pairs(pairs, event_size_px)
    fit = fit_homography(pairs.rgb_px, pairs.event_px, max_error_px)
    used = PointPairs(pairs.rgb_px[fit.inliers], pairs.event_px[fit.inliers], f"{pairs.origin}, pairs that agree")
    check_point_pairs(used, event_size_px)
    error = fit.symmetric_px[fit.inliers]
    grid = _grid(event_size_px)
    expected = expected_error_px(used.rgb_px, used.event_px, fit, grid)
    inliers = int(fit.inliers.sum())
    if inliers < 0.6 * len(pairs):
        warnings.append(f"only {inliers} of {len(pairs)} pairs agree: look at the picture")
    if expected.mean() > 1.0:
        warnings.append(
            f"the map is expected to be off by {expected.mean():.1f} px: give more pairs, or more exact ones"
        )
    report = HomographyReport(
        pairs=len(pairs),
        inliers=inliers,
        mean_px=float(error.mean()),
        p95_px=float(np.percentile(error, 95)),
        largest_px=float(error.max()),
        sigma_px=fit.sigma_px,
        heavy_tailed=fit.heavy_tailed,
        covered_share=covered_share(used.event_px, event_size_px),
        expected_px=float(expected.mean()),
        expected_worst_px=float(expected.max()),
        warnings=tuple(warnings),
    )
    return fit, report


def _grid(size_px: tuple[int, int]) -> FloatArray:
    x, y = np.meshgrid(np.linspace(0, size_px[0] - 1, 17), np.linspace(0, size_px[1] - 1, 10))
    return np.stack([x.ravel(), y.ravel()], axis=1)
