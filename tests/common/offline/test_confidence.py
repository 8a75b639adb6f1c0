from __future__ import annotations

import numpy as np
import pytest

from motiondlo.offline.confidence import area_under_roc, calibrate
from motiondlo.offline.evaluation import evaluate
from motiondlo.offline.tracks import make_tracks


def test_area_is_the_share_of_pairs_in_the_right_order():
    rng = np.random.default_rng(3)
    positive = rng.random(60) < 0.3
    score = np.round(rng.random(60) + 0.3 * positive, 1)
    above = score[positive][:, None] - score[~positive][None]
    assert area_under_roc(positive, score) == pytest.approx(((above > 0) + 0.5 * (above == 0)).mean())
    assert area_under_roc(np.zeros(5, bool), np.arange(5.0)) is None


def test_calibration_counts_by_bins():
    found = calibrate(np.array([0.05, 0.95, 1.0, 0.96, np.nan]), np.array([3.0, 0.1, 0.3, 2.5, 9.0]))
    assert (found.estimates, found.wrong) == (4, 2)
    assert [(row.low, row.count) for row in found.bins] == [(0.0, 1), (0.9, 3)]
    assert found.bins[1].wrong_share == pytest.approx(1 / 3)
    assert found.auc == pytest.approx(0.75)
    assert calibrate(np.array([np.nan]), np.array([1.0])) is None


def test_confidence_that_falls_with_the_estimate_is_seen_in_the_evaluation(make_truth, as_tracks):
    truth = make_truth(speeds_px_ms=(1.0,))
    tracks = as_tracks(truth)
    nodes = tracks.nodes.copy()
    off = tracks.times_us > 150_000
    nodes[off, :, 1] += 15.0
    told = make_tracks(tracks.times_us, nodes, confidence=np.where(off, 0.3, 0.9).astype(np.float32))
    calibration = evaluate(told, truth).calibration
    assert (calibration.auc, calibration.wrong) == (1.0, off.sum())
    assert evaluate(make_tracks(tracks.times_us, nodes), truth).calibration is None


@pytest.mark.parametrize("reverse", [False, True])
def test_slip_along_the_cable_is_judged_by_the_sigma_along_it(make_truth, as_tracks, reverse):
    truth = make_truth()
    tracks = as_tracks(truth, offset_px=(6.0, 0.0), reverse=reverse)
    sigma = np.full(tracks.nodes.shape[:2], 3.0, np.float32)
    (verdict,) = evaluate(make_tracks(tracks.times_us, tracks.nodes, sigma_tangent_px=sigma), truth).moved
    assert verdict.nees_tangent == pytest.approx(4.0, rel=1e-3)
    (unknown,) = evaluate(tracks, truth).moved
    assert unknown.nees_tangent is None


def test_shares_within_sigma(make_truth, as_tracks):
    truth = make_truth(speeds_px_ms=(0.5,))
    tracks = as_tracks(truth)
    nodes = tracks.nodes.copy()
    nodes[:, :25, 1] += 1.5
    nodes[:, 25:50, 1] += 2.5
    wide = make_tracks(tracks.times_us, nodes, sigma_px=np.ones(nodes.shape[:2], np.float32))
    (verdict,) = evaluate(wide, truth).moved
    assert verdict.within_sigma == pytest.approx((0.5, 0.75, 1.0), abs=0.02)
