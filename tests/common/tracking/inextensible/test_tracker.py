"""The tracker by scenario: a bar that sweeps, is pulled, stops, is covered, and is corrected late."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from motiondlo.events.reader import open_events
from motiondlo.events.types import EVENT_DTYPE, EventBatch, SensorGeometry, empty_events
from motiondlo.frames.appearance import sample_appearance
from motiondlo.frames.types import EndKind
from motiondlo.geometry.curve import distance_to_curve
from motiondlo.geometry.homography import load_homography
from motiondlo.recording.layout import open_recording, read_image
from motiondlo.rejects import RejectReason
from motiondlo.tracking.inextensible.params import InextensibleParams
from motiondlo.tracking.inextensible.tracker import InextensibleTracker
from motiondlo.tracking.types import Correction, CorrectionKind, TrackState


def tracker_for(scene, **correction) -> InextensibleTracker:
    tracker = InextensibleTracker(InextensibleParams(), scene.geometry)
    assert tracker.correct(scene.correction(**correction)) is None
    return tracker


def play(tracker: InextensibleTracker, scene, until_ms: int, start_ms: int = 0, period_us: int = 1000) -> TrackState:
    update = None
    for k in range(start_ms * 1000 // period_us, until_ms * 1000 // period_us):
        update = tracker.update(scene.batch(k, period_us))
    assert update is not None
    return update.tracks[0]


def normal_error_px(state: TrackState, scene, t_ms: float) -> float:
    return float(distance_to_curve(state.nodes, scene.nodes(t_ms)).mean())


@pytest.mark.parametrize("period_us", [1000, 2000, 5000])
def test_sweep_is_followed_at_every_batch_period(bar_scene, sweep_path, period_us: int) -> None:
    scene = bar_scene(sweep_path((0.0, 1.5)))
    state = play(tracker_for(scene), scene, 60, period_us=period_us)
    assert normal_error_px(state, scene, 60.0) < 1.0
    np.testing.assert_allclose(state.velocity_px_s[10:-10, 1], 1500.0, atol=150.0)
    assert state.moving
    assert state.visible[5:-5].all()


def test_first_shape_off_by_a_pixel_is_put_right_by_events(bar_scene, sweep_path) -> None:
    """HOMOGRAPHY_ERROR: the first shape carries the homography's error."""
    scene = bar_scene(sweep_path((0.0, 1.5)))
    tracker = InextensibleTracker(InextensibleParams(), scene.geometry)
    tracker.correct(scene.correction(shift_px=(0.0, 1.5)))
    assert normal_error_px(play(tracker, scene, 40), scene, 40.0) < 0.7


def test_pull_along_itself_is_seen_at_the_tips(bar_scene, sweep_path) -> None:
    scene = bar_scene(sweep_path((1.0, 0.0)))
    state = play(tracker_for(scene), scene, 50)
    assert np.abs(state.nodes[[0, -1], 0] - scene.nodes(50.0)[[0, -1], 0]).max() < 6.0


def test_uncertainty_covers_the_error(bar_scene, sweep_path) -> None:
    scene = bar_scene(sweep_path((0.0, 1.5)))
    state = play(tracker_for(scene), scene, 50)
    error = state.nodes[:, 1] - scene.path(50.0)[1]
    nees = np.mean(error**2 / state.cov_px2[:, 2])
    assert nees < 4.0


def test_events_stop_midway_and_the_dlo_rests(bar_scene, sweep_path) -> None:
    """EVENTS_STOP_MIDWAY."""
    scene = bar_scene(sweep_path((0.0, 1.5)))
    tracker = tracker_for(scene)
    play(tracker, scene, 40)
    for k in range(40, 140):
        update = tracker.update(EventBatch(k * 1000, k * 1000 + 1000, empty_events()))
    state = update.tracks[0]
    assert not state.moving
    assert np.abs(state.velocity_px_s).max() < 100.0
    assert normal_error_px(state, scene, 40.0) < 15.0
    assert 2.0 < np.sqrt(state.cov_px2[:, 2]).max() < 8.0


def test_a_covered_middle_goes_on_as_prediction(bar_scene, sweep_path) -> None:
    """COVERED: a plate over the middle third."""
    scene = bar_scene(sweep_path((0.0, 1.5)), cover_px=(140.0, 260.0))
    state = play(tracker_for(scene), scene, 60)
    hidden = (state.nodes[:, 0] > 170.0) & (state.nodes[:, 0] < 230.0)
    assert distance_to_curve(state.nodes, scene.nodes(60.0)).max() < 4.0
    assert not state.visible[hidden].any()
    inner = np.abs(np.arange(len(hidden)) - 0.5 * (len(hidden) - 1)) < 0.3 * len(hidden)
    seen = ~hidden & inner
    assert np.sqrt(state.cov_px2[hidden, 2]).min() > np.sqrt(state.cov_px2[seen, 2]).mean()


def test_a_resting_dlo_costs_nothing_and_is_not_moved_by_noise(bar_scene) -> None:
    scene = bar_scene(lambda t_ms: (80.0, 80.0))
    tracker = tracker_for(scene)
    rng = np.random.default_rng(4)
    first = None
    for k in range(80):
        noise = np.zeros(12, EVENT_DTYPE)
        noise["t"] = np.sort(rng.integers(k * 1000, k * 1000 + 1000, 12))
        noise["x"], noise["y"] = rng.integers(0, 420, 12), rng.integers(0, 300, 12)
        update = tracker.update(EventBatch(k * 1000, k * 1000 + 1000, noise))
        first = update.tracks[0].nodes if first is None else first
        if k == 50:
            asleep_state = update.tracks[0]
    assert np.abs(update.tracks[0].nodes - first).max() < 0.5
    assert update.tracks[0] is asleep_state


def test_same_input_gives_same_output(bar_scene, sweep_path) -> None:
    scene = bar_scene(sweep_path((0.3, 1.2)))
    one = play(tracker_for(scene), scene, 30)
    two = play(tracker_for(scene), scene, 30)
    np.testing.assert_array_equal(one.nodes, two.nodes)
    np.testing.assert_array_equal(one.cov_px2, two.cov_px2)


def test_events_lost_for_a_while_widen_the_uncertainty(bar_scene, sweep_path) -> None:
    """GAP: 60 ms of batches are missing."""
    scene = bar_scene(sweep_path((0.0, 1.0)))
    tracker = tracker_for(scene)
    before = play(tracker, scene, 30)
    after = tracker.update(EventBatch(90_000, 91_000, empty_events())).tracks[0]
    assert np.sqrt(after.cov_px2[:, 2]).mean() > np.sqrt(before.cov_px2[:, 2]).mean()
    assert np.isfinite(after.nodes).all()


def test_time_that_goes_back_does_not_mix_old_events_in(bar_scene, sweep_path) -> None:
    """CLOCK_STEP: the recording starts again from its beginning."""
    scene = bar_scene(sweep_path((0.0, 1.0)))
    tracker = tracker_for(scene)
    play(tracker, scene, 40)
    assert tracker.correct(scene.correction(seq=1, t_us=0)) is None
    state = play(tracker, scene, 40)
    assert normal_error_px(state, scene, 40.0) < 1.0


def test_late_correction_moves_what_was_not_seen_since(bar_scene) -> None:
    """A DLO at rest, 3 px beside its shape: the late shape is believed, in part because nothing contradicted it."""
    scene = bar_scene(lambda t_ms: (80.0, 80.0))
    tracker = InextensibleTracker(InextensibleParams(), scene.geometry)
    tracker.correct(scene.correction(shift_px=(0.0, 3.0)))
    before = play(tracker, scene, 30)
    assert tracker.correct(scene.correction(seq=1, t_us=10_000, kind=CorrectionKind.BLEND)) is None
    after = play(tracker, scene, 31, start_ms=30)
    assert normal_error_px(after, scene, 31.0) < 0.8 * normal_error_px(before, scene, 30.0)
    assert after.t_corrected_us == 10_000


def test_the_same_picture_again_is_no_second_opinion(bar_scene) -> None:
    """A DLO at rest is segmented time and again: each shape has the errors of the one before."""
    scene = bar_scene(lambda t_ms: (80.0, 80.0))
    tracker = tracker_for(scene)
    before = play(tracker, scene, 20)
    for k in range(1, 6):
        again = scene.correction(seq=k, t_us=20_000 + 1000 * k, kind=CorrectionKind.BLEND, shift_px=(0.0, 1.0))
        play(tracker, scene, 21 + k, start_ms=20 + k)
        assert tracker.correct(again) is None
    after = play(tracker, scene, 27, start_ms=26)
    assert np.abs(after.nodes[:, 1] - before.nodes[:, 1] - 1.0).mean() < 0.3, "it is followed"
    # The ends may have turned a little: only what lies along the image's axes is compared.
    np.testing.assert_allclose(after.cov_px2[:, [0, 2]], before.cov_px2[:, [0, 2]], rtol=0.1, atol=0.1)


def test_a_shape_that_tells_nothing_changes_nothing_of_what_comes(bar_scene, sweep_path) -> None:
    """In motion an old shape says nothing of now: the bend that is remembered is not that of the moment either."""
    scene = bar_scene(sweep_path((0.0, 1.5)))
    alone, corrected = tracker_for(scene), tracker_for(scene)
    play(alone, scene, 50)
    play(corrected, scene, 50)
    assert corrected.correct(scene.correction(seq=1, t_us=10_000, kind=CorrectionKind.BLEND)) is None
    states = [play(tracker, scene, 80, start_ms=50) for tracker in (alone, corrected)]
    assert states[1].t_corrected_us == 10_000
    np.testing.assert_allclose(states[0].nodes[:, 1], states[1].nodes[:, 1], atol=0.1)
    # Along itself, where events tell the least, it may help.
    ends = [abs(float(state.nodes[0, 0]) - scene.path(80.0)[0]) for state in states]
    assert ends[1] <= ends[0] + 0.05


def test_late_correction_does_not_undo_what_events_measured(bar_scene, sweep_path) -> None:
    scene = bar_scene(sweep_path((0.0, 1.5)))
    tracker = tracker_for(scene)
    play(tracker, scene, 60)
    wrong = scene.correction(seq=1, t_us=20_000, kind=CorrectionKind.BLEND, shift_px=(0.0, 2.0))
    assert tracker.correct(wrong) is None
    assert normal_error_px(play(tracker, scene, 61, start_ms=60), scene, 61.0) < 1.0


def test_correction_waits_for_its_time(bar_scene) -> None:
    scene = bar_scene(lambda t_ms: (80.0, 80.0))
    tracker = tracker_for(scene)
    play(tracker, scene, 30)
    late = scene.correction(seq=1, t_us=10_000, kind=CorrectionKind.BLEND, not_before_us=40_000)
    assert tracker.correct(late) is None
    assert play(tracker, scene, 39, start_ms=30).t_corrected_us == 0
    assert play(tracker, scene, 42, start_ms=39).t_corrected_us == 10_000


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        ({"seq": 0, "t_us": 0}, RejectReason.REPEATED),
        ({"seq": 1, "dlo_id": 9}, RejectReason.UNKNOWN_ID),
        ({"seq": 1, "t_us": 900_000}, RejectReason.FUTURE_TIME),
        ({"seq": 1, "t_us": 20_000, "shift_px": (0.0, 60.0)}, RejectReason.IMPLAUSIBLE),
    ],
)
def test_refused_corrections_are_counted_and_change_nothing(bar_scene, change, reason: RejectReason) -> None:
    scene = bar_scene(lambda t_ms: (80.0, 80.0))
    tracker = tracker_for(scene)
    before = play(tracker, scene, 30)
    assert tracker.correct(scene.correction(**{"kind": CorrectionKind.BLEND, "t_us": 20_000, **change})) is reason
    update = tracker.update(scene.batch(30))
    assert update.rejects == {reason.value: 1}
    np.testing.assert_allclose(update.tracks[0].nodes, before.nodes, atol=1e-9)


def test_retired_track_is_gone_and_its_id_unknown(bar_scene) -> None:
    scene = bar_scene(lambda t_ms: (80.0, 80.0))
    tracker = tracker_for(scene)
    play(tracker, scene, 10)
    none = np.zeros(0)
    retire = Correction(1, 1, 9_000, CorrectionKind.RETIRE, np.zeros((0, 2)), none, none)
    assert tracker.correct(retire) is None
    assert tracker.update(scene.batch(10)).tracks == ()
    blend = scene.correction(seq=2, t_us=9_000, kind=CorrectionKind.BLEND)
    assert tracker.correct(blend) is RejectReason.UNKNOWN_ID


def test_reinitialised_track_counts_its_starts(bar_scene) -> None:
    scene = bar_scene(lambda t_ms: (80.0, 80.0))
    tracker = tracker_for(scene)
    play(tracker, scene, 10)
    assert tracker.correct(scene.correction(seq=1, t_us=8_000, shift_px=(0.0, 20.0))) is None
    state = play(tracker, scene, 11, start_ms=10)
    assert state.reinitialised == 1
    assert abs(state.nodes[:, 1].mean() - 100.0) < 1.0


def test_two_dlos_keep_their_ids_while_one_moves(bar_scene, sweep_path) -> None:
    moving, still = bar_scene(sweep_path((0.0, 1.2))), bar_scene(lambda t_ms: (80.0, 250.0))
    tracker = tracker_for(moving)
    tracker.correct(still.correction(seq=1, dlo_id=2))
    for k in range(50):
        update = tracker.update(moving.batch(k))
    by_id = {track.id: track for track in update.tracks}
    assert normal_error_px(by_id[1], moving, 50.0) < 1.0
    assert normal_error_px(by_id[2], still, 50.0) < 0.3
    assert by_id[1].moving
    assert not by_id[2].moving


def test_warm_up_leaves_the_tracker_as_it_is(bar_scene, sweep_path) -> None:
    scene = bar_scene(sweep_path())
    warm, cold = tracker_for(scene), tracker_for(scene)
    warm.warm_up()
    np.testing.assert_array_equal(play(warm, scene, 12).nodes, play(cold, scene, 12).nodes)


def test_stages_are_timed_only_when_asked_for(bar_scene, sweep_path) -> None:
    scene = bar_scene(sweep_path())
    assert tracker_for(scene).update(scene.batch(0)).stages_ns == {}
    timed = InextensibleTracker(InextensibleParams(), scene.geometry, timed=True)
    assert set(timed.update(scene.batch(0)).stages_ns) == {"surface", "near", "tracks", "result"}


@pytest.mark.shared_data
def test_fast_cord_of_a_recording_is_held(shared_data: Path) -> None:
    """40 ms of a 4 mm cord at up to 9 px/ms, from the visible shape of the first frame."""
    recording = open_recording(shared_data / "single_dlo3_speed50")
    truth = np.load(recording.ground_truth_path)
    start_us, end_us = 290_000, 345_000
    nodes = truth["nodes"][0, start_us // 1000].astype(np.float64)
    visible = np.flatnonzero(truth["visibility"][0, start_us // 1000] == 0)
    shape = nodes[visible[0] : visible[-1] + 1]
    event_from_rgb = load_homography(recording.path / "homography" / "rgb_to_event_H.npy")
    image = read_image(recording.frames[0].path)
    assert image is not None
    diameter_px = float(truth["diameters_mm"][0] * truth["px_per_mm"])
    tracker = InextensibleTracker(InextensibleParams(), SensorGeometry())
    tracker.correct(
        Correction(
            0, 0, start_us, CorrectionKind.REINITIALISE, shape, np.ones(len(shape)), np.full(len(shape), 4.0),
            diameter_px, (EndKind.HELD, EndKind.BORDER), sample_appearance(image, event_from_rgb, shape, diameter_px),
            not_before_us=start_us,
        )
    )  # fmt: skip
    update = None
    for batch in open_events(recording.events_path, None).batches(1000):
        if batch.t1_us > end_us:
            break
        if batch.t0_us >= start_us:
            update = tracker.update(batch)
    assert update is not None
    state = update.tracks[0]
    true_nodes = truth["nodes"][0, end_us // 1000].astype(np.float64)
    seen = true_nodes[truth["visibility"][0, end_us // 1000] == 0]
    assert distance_to_curve(seen, state.nodes).mean() / float(truth["px_per_mm"]) < 0.25
    assert state.moving
