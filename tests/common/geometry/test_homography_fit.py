"""The homography of noisy and of wrong pairs, against the exact one and against OpenCV's estimators."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import numpy.typing as npt
import pytest

from motiondlo.errors import CalibrationError
from motiondlo.geometry.homography import warp_points
from motiondlo.geometry.homography_fit import dlt, expected_error_px, fit_homography, minimise_transfer

FloatArray = npt.NDArray[np.float64]

TRUE = np.array([[1.17, -0.05, -60.0], [0.08, 1.12, -210.0], [8e-5, -4e-6, 1.0]])
ROBUST = {
    "RANSAC": cv2.RANSAC,
    "LMEDS": cv2.LMEDS,
    "RHO": cv2.RHO,
    "USAC_DEFAULT": cv2.USAC_DEFAULT,
    "USAC_PARALLEL": cv2.USAC_PARALLEL,
    "USAC_FAST": cv2.USAC_FAST,
    "USAC_ACCURATE": cv2.USAC_ACCURATE,
    "USAC_PROSAC": cv2.USAC_PROSAC,
    "USAC_MAGSAC": cv2.USAC_MAGSAC,
}


def pairs(seed: int, n: int = 24, sigma: float = 0.5) -> tuple[FloatArray, FloatArray]:
    rng = np.random.default_rng(seed)
    event = rng.uniform([60.0, 50.0], [1220.0, 670.0], (n, 2))
    rgb = warp_points(event, np.linalg.inv(TRUE))
    return rgb + rng.normal(0, sigma, (n, 2)), event + rng.normal(0, sigma, (n, 2))


def map_error(h: FloatArray, true: FloatArray = TRUE) -> float:
    x, y = np.meshgrid(np.linspace(0, 1279, 33), np.linspace(0, 719, 19))
    event = np.stack([x.ravel(), y.ravel()], axis=1)
    rgb = warp_points(event, np.linalg.inv(true))
    seen = (rgb >= 0).all(axis=1) & (rgb[:, 0] < 1296) & (rgb[:, 1] < 972)
    return float(np.hypot(*(warp_points(rgb[seen], h) - event[seen]).T).mean())


def test_exact_pairs_give_the_exact_homography() -> None:
    rgb, event = pairs(0, n=4, sigma=0.0)
    assert np.allclose(dlt(rgb, event) / dlt(rgb, event)[2, 2], TRUE, atol=1e-9)
    assert np.allclose(fit_homography(rgb, event).target_from_source, TRUE, atol=1e-7)


def test_the_refinement_reaches_the_least_symmetric_transfer_error() -> None:
    rgb, event = pairs(1)

    def cost(h: FloatArray) -> float:
        back = warp_points(event, np.linalg.inv(h))
        return float(((warp_points(rgb, h) - event) ** 2).sum() + ((back - rgb) ** 2).sum())

    best = minimise_transfer(rgb, event, np.ones(len(rgb)), dlt(rgb, event))
    best /= best[2, 2]
    for k in range(8):
        for sign in (-1.0, 1.0):
            other = best.copy().ravel()
            other[k] *= 1.0 + sign * 1e-4
            assert cost(other.reshape(3, 3)) > cost(best)


def test_outliers_are_refused_and_cost_little() -> None:
    errors, clean = [], []
    for seed in range(5):
        rgb, event = pairs(seed)
        clean.append(map_error(fit_homography(rgb, event).target_from_source))
        event[:7] += np.random.default_rng(seed).uniform(15.0, 60.0, (7, 2))
        fit = fit_homography(rgb, event)
        assert not fit.inliers[:7].any()
        assert fit.inliers[7:].all()
        errors.append(map_error(fit.target_from_source))
    assert np.mean(errors) < 1.6 * np.mean(clean)


def test_heavy_tails_are_noticed_and_gaussian_noise_is_left_alone() -> None:
    rng = np.random.default_rng(3)
    rgb, event = pairs(2, n=150, sigma=0.0)
    assert fit_homography(rgb, event + 0.4 * rng.standard_t(2.0, event.shape), 20.0).heavy_tailed
    assert not fit_homography(rgb, event + rng.normal(0, 0.5, event.shape)).heavy_tailed


def test_the_expected_error_is_the_error() -> None:
    place = np.array([[640.0, 360.0], [1279.0, 719.0]])
    expected, found = [], []
    for seed in range(40):
        rgb, event = pairs(seed)
        fit = fit_homography(rgb, event)
        expected.append(expected_error_px(rgb, event, fit, place) ** 2)
        gap = warp_points(warp_points(place, np.linalg.inv(TRUE)), fit.target_from_source) - place
        found.append((gap**2).sum(axis=1))
    ratio = np.sqrt(np.mean(found, axis=0) / np.mean(expected, axis=0))
    assert (ratio > 0.75).all()
    assert (ratio < 1.35).all()


def test_pairs_in_the_wrong_order_are_refused() -> None:
    rgb, event = pairs(4)
    with pytest.raises(CalibrationError, match="no homography explains"):
        fit_homography(rgb, np.random.default_rng(0).permutation(event))


@pytest.mark.shared_data
def test_no_robust_estimator_of_opencv_is_better_on_the_recordings(shared_data: Path) -> None:
    errors: dict[str, list[float]] = {"ours": []}
    for path in sorted(shared_data.glob("*/homography/calibration_points.npz")):
        with np.load(path) as points, np.load(path.parents[1] / "ground_truth.npz") as truth:
            rgb, event, true = points["rgb_px"], points["event_px"], truth["H_true"]
        errors["ours"].append(map_error(fit_homography(rgb, event).target_from_source, true))
        for name, method in ROBUST.items():
            cv2.setRNGSeed(0)
            errors.setdefault(name, []).append(map_error(cv2.findHomography(rgb, event, method, 3.0)[0], true))
    means = {name: float(np.mean(values)) for name, values in errors.items()}
    assert means["ours"] <= min(means.values()) + 1e-9, means
