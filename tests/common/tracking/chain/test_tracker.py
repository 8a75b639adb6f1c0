"""The tracker by scenario: sweeps, pulls, stops, silence, covers, bystanders, gaps, noise, late corrections."""

from __future__ import annotations

import numpy as np
import pytest

from motiondlo.events.reader import open_events
from motiondlo.events.types import EVENT_DTYPE, EventBatch, empty_events
from motiondlo.frames.appearance import sample_appearance
from motiondlo.frames.types import EndKind
from motiondlo.geometry.curve import distance_to_curve
from motiondlo.recording.layout import open_recording, read_image
from motiondlo.rejects import RejectReason
from motiondlo.tracking.chain.params import ChainParams
from motiondlo.tracking.chain.tracker import ChainTracker
from motiondlo.tracking.types import Correction, CorrectionKind, TrackSource, TrackUpdate


def tracker_of(scene, count: int = 1, **correction) -> ChainTracker:
    tracker = ChainTracker(ChainParams(), scene.geometry)
    for which in range(count):
        assert tracker.correct(scene.correction(which, seq=which + 1, **correction)) is None
    return tracker


def play(tracker: ChainTracker, scene, until_ms: int, from_ms: int = 0, period_us: int = 1000) -> TrackUpdate:
    update = None
    for t0_us in range(from_ms * 1000, until_ms * 1000, period_us):
        update = tracker.update(scene.batch(t0_us, period_us))
    assert update is not None
    return update


def normal_error_px(update: TrackUpdate, scene, t_ms: float, which: int = 0) -> float:
    return float(distance_to_curve(update.tracks[which].nodes, scene.cables[which].nodes(t_ms)).mean())


def tip_error_px(update: TrackUpdate, scene, t_ms: float) -> float:
    return float(np.hypot(*(update.tracks[0].nodes[-1] - scene.cables[0].nodes(t_ms)[-1])))


@pytest.mark.parametrize("period_us", [1000, 2000, 5000])
def test_sweep_is_followed_at_every_batch_period(make_scene, make_cable, moving, period_us: int) -> None:
    scene = make_scene(make_cable(moving((0.3, 2.0))))
    update = play(tracker_of(scene), scene, 50, period_us=period_us)
    state = update.tracks[0]
    assert normal_error_px(update, scene, 50.0) < 1.0
    np.testing.assert_allclose(state.velocity_px_s[10:-10, 1], 2000.0, atol=250.0)
    assert state.moving
    assert state.source is TrackSource.EVENT
    assert state.visible[5:-5].all()
    assert state.confidence > 0.6
    assert update.active_ratio > 0.0


def test_first_shape_off_by_a_pixel_is_put_right_by_events(make_scene, make_cable, moving) -> None:
    """HOMOGRAPHY_ERROR: the first shape, not the look, carries the homography's error."""
    scene = make_scene(make_cable(moving((0.0, 2.0))))
    tracker = ChainTracker(ChainParams(), scene.geometry)
    tracker.correct(scene.correction(shift_px=(0.0, 1.5)))
    assert normal_error_px(play(tracker, scene, 40), scene, 40.0) < 0.7


def test_pull_along_itself_is_seen_at_the_tip(make_scene, make_cable, moving) -> None:
    scene = make_scene(make_cable(moving((1.5, 0.0)), bend_px=0.0))
    update = play(tracker_of(scene), scene, 40)
    assert tip_error_px(update, scene, 40.0) < 3.0


def test_marks_hold_a_cable_whose_ends_say_nothing(make_scene, make_cable, moving) -> None:
    scene = make_scene(make_cable(moving((1.5, 0.3)), bend_px=0.0, marks=True))
    hidden = (EndKind.HIDDEN, EndKind.HIDDEN)
    with_marks = play(tracker_of(scene, ends=hidden), scene, 40)
    assert tip_error_px(with_marks, scene, 40.0) < 12.0
    plain = make_scene(make_cable(moving((1.5, 0.3)), bend_px=0.0))
    without = play(tracker_of(plain, ends=hidden), plain, 40)
    assert tip_error_px(without, plain, 40.0) > 3.0 * tip_error_px(with_marks, scene, 40.0)


def test_a_gripper_carries_its_end_along(make_scene, make_cable, moving) -> None:
    scene = make_scene(make_cable(moving((1.5, 0.4)), start=(130.0, 110.0), bend_px=0.0, held=True))
    update = play(tracker_of(scene, ends=(EndKind.HELD, EndKind.HIDDEN)), scene, 40)
    assert tip_error_px(update, scene, 40.0) < 6.0


def test_silence_freezes_and_sleeping_costs_no_state(make_scene, make_cable, moving) -> None:
    """EVENTS_STOP_MIDWAY: the cable stops; it is held where it is, exactly."""
    scene = make_scene(make_cable(moving((0.0, 2.0), stop_ms=30.0)))
    tracker = tracker_of(scene)
    play(tracker, scene, 30)
    stopped = play(tracker, scene, 110, from_ms=30)
    later = play(tracker, scene, 160, from_ms=110)
    assert not later.tracks[0].moving
    assert later.tracks[0] is stopped.tracks[0]
    # It was fast and stopped from one millisecond to the next.
    assert normal_error_px(later, scene, 160.0) < 2.5
    assert np.sqrt(later.tracks[0].cov_px2.max()) < 6.0


def test_a_cable_at_rest_wakes_up(make_scene, make_cable, moving) -> None:
    scene = make_scene(make_cable(moving((0.0, 1.5), start_ms=80.0)))
    tracker = tracker_of(scene)
    assert not play(tracker, scene, 75).tracks[0].moving
    update = play(tracker, scene, 110, from_ms=75)
    assert update.tracks[0].moving
    assert normal_error_px(update, scene, 110.0) < 1.0


def test_what_a_plate_hides_goes_along(make_scene, make_cable, moving) -> None:
    """OCCLUSION: no events under the plate do not mean rest there."""
    scene = make_scene(make_cable(moving((0.0, 1.5))), cover=(210, 290))
    update = play(tracker_of(scene), scene, 50)
    state = update.tracks[0]
    assert normal_error_px(update, scene, 50.0) < 1.5
    hidden = (state.nodes[:, 0] > 230) & (state.nodes[:, 0] < 270)
    assert not state.visible[hidden].any()


def test_a_bystander_is_not_carried_off(make_scene, make_cable, moving) -> None:
    """TWO_CROSSING: a moving cable sweeps over one at rest."""
    mover = make_cable(moving((0.0, 3.0)), start=(60.0, 40.0), bend_px=5.0)
    still = make_cable(lambda _t: (0.0, 0.0), start=(150.0, 140.0), bend_px=20.0, grey=120)
    scene = make_scene(still, mover)
    update = play(tracker_of(scene, count=2), scene, 60)
    assert normal_error_px(update, scene, 60.0, 0) < 1.0
    assert normal_error_px(update, scene, 60.0, 1) < 1.5


def test_noise_and_hot_pixels_move_nothing(make_scene, make_cable, moving) -> None:
    """HOT_PIXEL: a cable at rest among stray events stays where it is."""
    scene = make_scene(make_cable(lambda _t: (0.0, 0.0)))
    tracker = tracker_of(scene)
    rng = np.random.default_rng(3)
    update = None
    for k in range(60):
        n = 40
        noise = np.zeros(n + 2, EVENT_DTYPE)
        noise["t"] = k * 1000 + np.sort(rng.integers(0, 1000, n + 2))
        noise["x"] = np.append(rng.integers(0, 480, n), [250, 250])
        noise["y"] = np.append(rng.integers(0, 320, n), [135, 136])
        noise["p"] = rng.integers(0, 2, n + 2)
        update = tracker.update(EventBatch(k * 1000, (k + 1) * 1000, noise))
    assert update is not None
    assert normal_error_px(update, scene, 0.0) < 0.5


def test_a_flash_moves_nothing(make_scene, make_cable) -> None:
    scene = make_scene(make_cable(lambda _t: (0.0, 0.0)))
    tracker = tracker_of(scene)
    y, x = np.mgrid[60:200, 80:420]
    update = None
    for k in range(20):
        flash = empty_events(x.size if k == 5 else 0)
        if len(flash):
            flash["t"], flash["x"], flash["y"], flash["p"] = k * 1000 + 500, x.ravel(), y.ravel(), 1
        update = tracker.update(EventBatch(k * 1000, (k + 1) * 1000, flash))
    assert update is not None
    assert normal_error_px(update, scene, 0.0) < 1.0


def test_a_gap_in_the_batches_is_bridged_with_growing_doubt(make_scene, make_cable, moving) -> None:
    scene = make_scene(make_cable(moving((0.0, 1.0))))
    tracker = tracker_of(scene)
    before = play(tracker, scene, 30).tracks[0]
    after = tracker.update(EventBatch(500_000, 501_000, empty_events(), lost_before=469)).tracks[0]
    assert np.isfinite(after.nodes).all()
    assert after.cov_px2.max() > 4.0 * before.cov_px2.max()


def test_same_input_gives_the_same_output(make_scene, make_cable, moving) -> None:
    def nodes() -> np.ndarray:
        scene = make_scene(make_cable(moving((0.5, 1.5)), marks=True))
        return play(tracker_of(scene), scene, 25).tracks[0].nodes

    np.testing.assert_array_equal(nodes(), nodes())


def test_late_correction_is_carried_forward(make_scene, make_cable, moving) -> None:
    """A frame of 20 ms, which arrives at 50 ms, moves a shifted track the right way, and is not taken twice."""
    scene = make_scene(make_cable(moving((0.0, 1.0)), bend_px=0.0))
    tracker = tracker_of(scene, look=False, shift_px=(12.0, 0.0))
    update = play(tracker, scene, 50)
    off_before = tip_error_px(update, scene, 50.0)
    late = scene.correction(seq=9, t_us=20_000, kind=CorrectionKind.BLEND)
    assert tracker.correct(late) is None
    update = play(tracker, scene, 51, from_ms=50)
    assert update.tracks[0].t_corrected_us == 20_000
    assert tip_error_px(update, scene, 51.0) < 0.75 * off_before
    assert tracker.correct(late) is RejectReason.REPEATED
    older = scene.correction(seq=10, t_us=10_000, kind=CorrectionKind.BLEND)
    assert tracker.correct(older) is RejectReason.OUT_OF_ORDER


def test_correction_waits_for_its_time(make_scene, make_cable, moving) -> None:
    scene = make_scene(make_cable(moving((0.0, 1.0))))
    tracker = tracker_of(scene)
    play(tracker, scene, 10)
    blend = scene.correction(seq=5, t_us=8_000, kind=CorrectionKind.BLEND, not_before_us=20_000)
    assert tracker.correct(blend) is None
    assert play(tracker, scene, 19, from_ms=10).tracks[0].t_corrected_us == 0
    assert play(tracker, scene, 21, from_ms=19).tracks[0].t_corrected_us == 8_000


def test_implausible_and_foreign_corrections_are_refused(make_scene, make_cable, moving) -> None:
    scene = make_scene(make_cable(moving((0.0, 1.0))))
    tracker = tracker_of(scene)
    play(tracker, scene, 20)
    far = scene.correction(seq=3, t_us=15_000, kind=CorrectionKind.BLEND, shift_px=(0.0, 60.0))
    assert tracker.correct(far) is RejectReason.IMPLAUSIBLE
    unknown = Correction(4, 77, 15_000, CorrectionKind.BLEND, far.nodes, far.sigma_normal_px, far.sigma_tangent_px)
    assert tracker.correct(unknown) is RejectReason.UNKNOWN_ID
    future = scene.correction(seq=5, t_us=9_000_000, kind=CorrectionKind.BLEND)
    assert tracker.correct(future) is RejectReason.FUTURE_TIME
    rejects = play(tracker, scene, 21, from_ms=20).rejects
    assert rejects == {"implausible": 1, "unknown_id": 1, "future_time": 1}


def test_new_start_from_a_late_frame_is_carried_to_now(make_scene, make_cable, moving) -> None:
    scene = make_scene(make_cable(moving((0.0, 2.0))))
    tracker = tracker_of(scene)
    play(tracker, scene, 40)
    assert tracker.correct(scene.correction(seq=2, t_us=20_000)) is None
    update = play(tracker, scene, 41, from_ms=40)
    assert update.tracks[0].reinitialised == 1
    assert normal_error_px(update, scene, 41.0) < 3.0
    assert normal_error_px(play(tracker, scene, 60, from_ms=41), scene, 60.0) < 1.0


def test_retired_tracks_end(make_scene, make_cable, moving) -> None:
    scene = make_scene(make_cable(moving((0.0, 1.0))))
    tracker = tracker_of(scene)
    play(tracker, scene, 5)
    nothing = np.zeros((0, 2))
    retire = Correction(2, 0, 5_000, CorrectionKind.RETIRE, nothing, np.zeros(0), np.zeros(0))
    assert tracker.correct(retire) is None
    assert play(tracker, scene, 7, from_ms=5).tracks == ()


def test_stage_times_only_when_asked_for(make_scene, make_cable, moving) -> None:
    scene = make_scene(make_cable(moving((0.0, 1.0))))
    quiet = ChainTracker(ChainParams(), scene.geometry)
    assert quiet.update(EventBatch(0, 1000, empty_events())).stages_ns == {}
    timed = ChainTracker(ChainParams(), scene.geometry, timed=True)
    assert set(timed.update(EventBatch(0, 1000, empty_events())).stages_ns) == {"surface", "filter", "report"}


@pytest.mark.shared_data
def test_onset_of_a_real_sweep(shared_data) -> None:
    """The first 120 ms of motion of a recording, from its true first shape, within a third of a millimetre."""
    recording = open_recording(shared_data / "single_dlo3_speed50")
    truth = np.load(recording.ground_truth_path)
    seen = np.flatnonzero(truth["visibility"][0, 0] == 0)
    nodes = truth["nodes"][0, 0, seen[0] : seen[-1] + 1].astype(np.float64)
    image = read_image(recording.frames[0].path)
    assert image is not None
    px_per_mm = float(truth["px_per_mm"])
    diameter = float(truth["diameters_mm"][0]) * px_per_mm
    look = sample_appearance(image, recording.event_from_rgb(), nodes, diameter)
    sigma = np.ones(len(nodes))
    events = open_events(recording.events_path)
    tracker = ChainTracker(ChainParams(), events.geometry)
    ends = (EndKind.HELD, EndKind.BORDER)
    tracker.correct(Correction(1, 0, 0, CorrectionKind.REINITIALISE, nodes, sigma, 3 * sigma, diameter, ends, look))
    errors = []
    for batch in events.batches(1000):
        update = tracker.update(batch)
        if batch.t1_us >= 420_000:
            break
        if batch.t1_us >= 310_000:
            k = batch.t1_us // 1000
            visible = truth["visibility"][0, k] == 0
            errors.append(
                distance_to_curve(truth["nodes"][0, k][visible].astype(np.float64), update.tracks[0].nodes).mean()
            )
    assert np.mean(errors) / px_per_mm < 0.33
