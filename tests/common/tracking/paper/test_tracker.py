"""The paper's tracker by scenario, on a synthetic bar and on pieces of the simulated recordings."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from motiondlo.events.reader import read_all
from motiondlo.events.types import EventArray, EventBatch, SensorGeometry, empty_events
from motiondlo.geometry.curve import distance_to_curve, resample
from motiondlo.rejects import RejectReason
from motiondlo.tracking.paper.params import PaperParams
from motiondlo.tracking.paper.tracker import PaperTracker
from motiondlo.tracking.types import Correction, CorrectionKind, TrackSource, TrackUpdate

SENSOR = SensorGeometry()
Bar = Callable[[int, int, float], EventArray]
Cut = Callable[[EventArray, int, int], list[EventBatch]]
SWITCHES = [name for name, field in PaperParams.model_fields.items() if field.annotation is bool]


def bar_at(y: float) -> np.ndarray:
    """The synthetic bar's centreline at a height."""
    return np.array([[300.0, y], [900.0, y]])


def play(tracker: PaperTracker, batches: Iterable[EventBatch]) -> list[TrackUpdate]:
    """Updates for all batches, each checked for what must never happen."""
    updates = [tracker.update(batch) for batch in batches]
    for track in (track for update in updates for track in update.tracks):
        assert np.isfinite(track.nodes).all()
        assert np.isfinite(track.velocity_px_s).all()
        assert np.isfinite(track.cov_px2).all()
        assert (track.cov_px2[:, [0, 2]] > 0.0).all()
        assert np.hypot(*np.diff(track.nodes, axis=0).T).min() > 0.0
        assert 0.0 <= track.confidence <= 1.0
    return updates


@pytest.mark.parametrize("period_us", [500, 2000, 5000])
def test_bar_sweeps_at_4_px_per_ms_and_is_followed(
    sweeping_bar: Bar, cut: Cut, bar_start: Correction, period_us: int
) -> None:
    tracker = PaperTracker(PaperParams(), SENSOR)
    assert tracker.correct(bar_start) is None
    updates = play(tracker, cut(sweeping_bar(0, 80_000, 4.0), 80_000, period_us))
    (track,) = updates[-1].tracks
    assert track.id == 3
    assert track.moving
    assert track.source is TrackSource.EVENT
    assert distance_to_curve(track.nodes, bar_at(200.0 + 4.0 * 80.0)).mean() < 10.0
    assert np.median(track.velocity_px_s[:, 1]) == pytest.approx(4000.0, rel=0.25)
    assert abs(track.nodes[0, 0] - 300.0) < 40.0
    assert abs(track.nodes[-1, 0] - 900.0) < 40.0
    stages = {stage for update in updates for stage in update.stages_ns}
    assert {"noise_filter", "time_surfaces", "recentness", "morphology", "skeleton_path", "registration"} <= stages


def test_same_input_gives_the_same_updates(sweeping_bar: Bar, cut: Cut, bar_start: Correction) -> None:
    batches = cut(sweeping_bar(0, 40_000, 4.0), 40_000, 2000)
    runs = []
    for _ in range(2):
        tracker = PaperTracker(PaperParams(), SENSOR)
        tracker.correct(bar_start)
        runs.append(np.concatenate([u.tracks[0].nodes for u in play(tracker, batches)]))
    np.testing.assert_array_equal(runs[0], runs[1])


def test_between_updates_the_last_estimate_stands(sweeping_bar: Bar, cut: Cut, bar_start: Correction) -> None:
    tracker = PaperTracker(PaperParams(), SENSOR)
    tracker.correct(bar_start)
    updates = play(tracker, cut(sweeping_bar(0, 40_000, 4.0), 40_000, 1000))
    np.testing.assert_array_equal(updates[-2].tracks[0].nodes, updates[-3].tracks[0].nodes)
    assert not np.array_equal(updates[-1].tracks[0].nodes, updates[-2].tracks[0].nodes)
    assert [u.t_us for u in updates] == list(range(1000, 40_001, 1000))


def test_events_stop_midway_and_the_track_hibernates_where_it_was(
    sweeping_bar: Bar, cut: Cut, bar_start: Correction
) -> None:
    tracker = PaperTracker(PaperParams(), SENSOR)
    tracker.correct(bar_start)
    updates = play(tracker, cut(sweeping_bar(0, 60_000, 4.0), 300_000, 2000))
    assert updates[25].tracks[0].moving
    (track,) = updates[-1].tracks
    assert not track.moving
    assert not track.velocity_px_s.any()
    assert distance_to_curve(track.nodes, bar_at(440.0)).mean() < 40.0
    assert updates[-1].active_ratio == 0.0


def test_silence_and_noise_leave_a_resting_dlo_alone(cut: Cut, bar_start: Correction) -> None:
    rng = np.random.default_rng(5)
    noise = empty_events(2000)
    noise["t"] = np.sort(rng.integers(0, 100_000, 2000))
    noise["x"], noise["y"], noise["p"] = rng.integers(0, 1280, 2000), rng.integers(0, 720, 2000), 1
    tracker = PaperTracker(PaperParams(), SENSOR)
    tracker.correct(bar_start)
    updates = play(tracker, cut(noise, 100_000, 2000))
    assert not any(u.tracks[0].moving for u in updates)
    np.testing.assert_allclose(updates[-1].tracks[0].nodes, resample(bar_start.nodes, 20))
    assert updates[-1].tracks[0].source is TrackSource.FRAME


def test_without_a_frame_the_events_start_dlo_0_and_a_frame_takes_over(
    sweeping_bar: Bar, cut: Cut, bar_start: Correction
) -> None:
    tracker = PaperTracker(PaperParams(), SENSOR)
    batches = cut(sweeping_bar(0, 80_000, 2.0), 80_000, 2000)
    assert tracker.update(batches[0]).tracks == ()
    updates = play(tracker, batches[1:])
    (track,) = updates[-1].tracks
    assert track.id == 0
    assert track.t_corrected_us == -1
    assert distance_to_curve(track.nodes, bar_at(360.0)).mean() < 15.0
    tracker.correct(replace(bar_start, t_us=80_000))
    after = tracker.update(EventBatch(80_000, 82_000, empty_events()))
    assert [t.id for t in after.tracks] == [3]


def test_moving_dlo_is_registered_and_the_resting_one_is_held(
    sweeping_bar: Bar, cut: Cut, bar_start: Correction
) -> None:
    tracker = PaperTracker(PaperParams(), SENSOR)
    other = bar_start.nodes + np.array([0.0, 450.0])
    tracker.correct(bar_start)
    tracker.correct(replace(bar_start, seq=1, id=1, nodes=other))
    tracks = {t.id: t for t in play(tracker, cut(sweeping_bar(0, 40_000, 4.0), 40_000, 2000))[-1].tracks}
    assert tracks[3].moving
    assert not tracks[1].moving
    np.testing.assert_allclose(tracks[1].nodes, resample(other, 20))


def test_late_correction_at_rest_replaces_the_shape_once(bar_start: Correction) -> None:
    tracker = PaperTracker(PaperParams(), SENSOR)
    tracker.correct(bar_start)
    tracker.update(EventBatch(0, 2000, empty_events()))
    shifted = bar_start.nodes + np.array([0.0, 6.0])
    certain = np.full(40, 1e-3)
    blend = replace(
        bar_start,
        seq=1,
        kind=CorrectionKind.BLEND,
        nodes=shifted,
        sigma_normal_px=certain,
        t_us=1000,
        not_before_us=9000,
    )
    # A second frame of the same time of rest, taken before the first correction arrived: nothing is left to correct.
    again = replace(blend, seq=2, t_us=2000, not_before_us=11_000)
    tracker.update(EventBatch(2000, 4000, empty_events()))
    assert tracker.correct(blend) is None
    assert tracker.correct(again) is None
    heights = []
    for t0_us in range(4000, 14_000, 2000):
        (track,) = tracker.update(EventBatch(t0_us, t0_us + 2000, empty_events())).tracks
        heights.append((t0_us + 2000, float(track.nodes[:, 1].mean())))
    assert heights == [
        (6000, 200.0),
        (8000, 200.0),
        *[(t, pytest.approx(206.0, abs=0.01)) for t in (10_000, 12_000, 14_000)],
    ]
    assert track.t_corrected_us == 2000
    assert tracker.correct(blend) is RejectReason.REPEATED
    assert tracker.correct(replace(blend, seq=3, id=8)) is RejectReason.UNKNOWN_ID
    assert tracker.update(EventBatch(14_000, 16_000, empty_events())).rejects == {"repeated": 1, "unknown_id": 1}


def test_late_correction_in_motion_is_carried_to_now(sweeping_bar: Bar, cut: Cut, bar_start: Correction) -> None:
    tracker = PaperTracker(PaperParams(), SENSOR)
    tracker.correct(bar_start)
    batches = cut(sweeping_bar(0, 62_000, 4.0), 62_000, 2000)
    before = play(tracker, batches[:30])[-1].tracks[0].nodes
    at_40_ms = np.stack([np.linspace(300, 900, 40), np.full(40, 360.0)], axis=1)
    certain = np.full(40, 0.1)
    tracker.correct(
        replace(bar_start, seq=1, kind=CorrectionKind.BLEND, t_us=40_000, nodes=at_40_ms, sigma_normal_px=certain)
    )
    after = tracker.update(batches[30]).tracks[0]
    truth = bar_at(200.0 + 4.0 * 62.0)
    assert distance_to_curve(after.nodes, truth).mean() < 8.0
    assert np.abs(after.nodes[:, 1] - before[:, 1]).max() < 30.0  # not thrown back to where the frame saw it
    assert after.t_corrected_us == 40_000


def test_retired_dlo_is_gone_and_time_backwards_is_counted(bar_start: Correction) -> None:
    tracker = PaperTracker(PaperParams(), SENSOR)
    tracker.correct(bar_start)
    tracker.update(EventBatch(0, 4000, empty_events()))
    late = tracker.update(EventBatch(0, 2000, empty_events()))
    assert late.t_us == 4000
    assert late.rejects == {"time_backwards": 1}
    nothing = np.zeros((0, 2))
    none = np.zeros(0)
    assert tracker.correct(Correction(1, 3, 4000, CorrectionKind.RETIRE, nothing, none, none)) is None
    assert tracker.update(EventBatch(4000, 6000, empty_events())).tracks == ()


def test_dlo_that_leaves_the_image_stays_finite(sweeping_bar: Bar, cut: Cut, bar_start: Correction) -> None:
    tracker = PaperTracker(PaperParams(), SENSOR)
    tracker.correct(bar_start)
    swept = sweeping_bar(0, 150_000, 4.0)
    updates = play(tracker, cut(swept[swept["y"] < 720], 150_000, 2000))
    assert len(updates[-1].tracks) == 1


def test_gap_of_half_a_second_is_survived(sweeping_bar: Bar, cut: Cut, bar_start: Correction) -> None:
    tracker = PaperTracker(PaperParams(), SENSOR)
    tracker.correct(bar_start)
    batches = cut(sweeping_bar(0, 40_000, 4.0), 40_000, 2000)
    updates = play(tracker, [*batches, EventBatch(540_000, 542_000, empty_events())])
    assert distance_to_curve(updates[-1].tracks[0].nodes, bar_at(360.0)).mean() < 40.0


@pytest.mark.parametrize("switch", SWITCHES)
def test_every_component_can_be_taken_out(sweeping_bar: Bar, cut: Cut, bar_start: Correction, switch: str) -> None:
    tracker = PaperTracker(PaperParams(**{switch: False}), SENSOR)  # type: ignore[arg-type]
    tracker.correct(bar_start)
    updates = play(tracker, cut(sweeping_bar(0, 24_000, 3.0), 24_000, 2000))
    assert updates[-1].tracks[0].moving


@pytest.mark.shared_data
@pytest.mark.parametrize("name", ["single_dlo2_speed100", "lighting", "loop", "drag"])
def test_recorded_onset_gives_finite_tracks(shared_data: Path, name: str) -> None:
    events, _ = read_all(shared_data / name / "events.raw")
    truth = np.load(shared_data / name / "ground_truth.npz")
    onset_us = int(truth["times_us"][truth["moving"].any(axis=0)][0])
    tracker = PaperTracker(PaperParams(), SENSOR)
    for k, nodes in enumerate(truth["nodes"][:, 0].astype(np.float64)):
        seen = nodes[truth["visibility"][k, 0] == 0]
        ones = np.ones(len(seen))
        diameter_px = float(truth["diameters_mm"][k] * truth["px_per_mm"])
        tracker.correct(Correction(k, k, 0, CorrectionKind.REINITIALISE, seen, ones, ones, diameter_px))
    start_us = onset_us // 2000 * 2000 - 6000
    piece = events[(events["t"] >= start_us) & (events["t"] < start_us + 60_000)]
    edges = range(start_us, start_us + 60_000, 2000)
    cuts = np.searchsorted(piece["t"], [*edges, start_us + 60_000])
    batches = [EventBatch(t, t + 2000, piece[a:b]) for t, a, b in zip(edges, cuts[:-1], cuts[1:], strict=True)]
    updates = play(tracker, batches)
    assert any(track.moving for track in updates[-1].tracks)


@pytest.mark.shared_data
def test_fast_cord_is_held(shared_data: Path) -> None:
    recording = shared_data / "single_dlo3_speed50"
    events, _ = read_all(recording / "events.raw")
    truth = np.load(recording / "ground_truth.npz")
    times_us, curves = truth["times_us"], truth["nodes"][0].astype(np.float64)
    seen = curves[0][truth["visibility"][0, 0] == 0]
    ones = np.ones(len(seen))
    diameter_px = float(truth["diameters_mm"][0] * truth["px_per_mm"])
    tracker = PaperTracker(PaperParams(), SENSOR)
    tracker.correct(Correction(0, 0, 0, CorrectionKind.REINITIALISE, seen, ones, ones, diameter_px))
    edges = range(296_000, 420_000, 2000)
    cuts = np.searchsorted(events["t"], [*edges, 420_000])
    updates = play(
        tracker, [EventBatch(t, t + 2000, events[a:b]) for t, a, b in zip(edges, cuts[:-1], cuts[1:], strict=True)]
    )
    errors_px = [
        distance_to_curve(u.tracks[0].nodes, curves[int(np.searchsorted(times_us, u.t_us))]).mean() for u in updates
    ]
    assert np.mean(errors_px) / float(truth["px_per_mm"]) < 3.0
