from __future__ import annotations

import shutil

import numpy as np
import pytest

from motiondlo.errors import CalibrationError, ConfigError, RecordingError
from motiondlo.offline.options import TrackMode, TrackOptions
from motiondlo.offline.run_track import prepare, track_recording
from motiondlo.recording.layout import open_recording

FRAME_MODE = TrackOptions(mode=TrackMode.FRAME, segmenter_latency_ms=20.0, update_us=5000)


@pytest.mark.shared_data
def test_same_recording_gives_the_same_tracks_and_progress_ends_at_one(excerpt):
    recording = open_recording(excerpt())
    shares: list[float] = []
    first, second = track_recording(recording, FRAME_MODE, shares.append), track_recording(recording, FRAME_MODE)
    assert len(first) > 10
    np.testing.assert_array_equal(first.times_us, second.times_us)
    np.testing.assert_array_equal(first.nodes, second.nodes)
    assert shares == sorted(shares)
    assert shares[-1] == 1.0


@pytest.mark.shared_data
def test_rows_do_not_depend_on_what_comes_later(excerpt):
    whole = track_recording(open_recording(excerpt(frames=3)), FRAME_MODE)
    part = track_recording(open_recording(excerpt(event_bytes=300_000, frames=2)), FRAME_MODE)
    n = int((part.times_us < 100_000).sum())
    assert n > 10
    np.testing.assert_array_equal(whole.times_us[:n], part.times_us[:n])
    np.testing.assert_array_equal(whole.nodes[:n], part.nodes[:n])


@pytest.mark.shared_data
def test_homography_is_needed_for_frames_and_not_for_events(excerpt):
    folder = excerpt()
    np.save(folder / "homography" / "rgb_to_event_H.npy", np.zeros((3, 3)))
    with pytest.raises(CalibrationError, match="singular"):
        prepare(open_recording(folder), TrackOptions())
    shutil.rmtree(folder / "homography")
    with pytest.raises(CalibrationError, match="--mode event"):
        prepare(open_recording(folder), TrackOptions())
    prepare(open_recording(folder), TrackOptions(mode=TrackMode.EVENT))


@pytest.mark.shared_data
def test_recording_without_frames_says_which_mode_needs_none(excerpt):
    folder = excerpt(frames=0)
    with pytest.raises(RecordingError, match="--mode event"):
        prepare(open_recording(folder), TrackOptions())


@pytest.mark.shared_data
def test_unreadable_first_frame_is_a_failed_segmentation(excerpt):
    folder = excerpt()
    (folder / "frames" / "frame_000001.jpg").write_bytes(b"\xff\xd8 cut short")
    run = prepare(open_recording(folder), FRAME_MODE)
    states = list(run.states())
    assert run.loop.failures == ["frame_000001.jpg: frame_unreadable"]
    assert any(state.dlos for state in states)
    assert any("frame_unreadable" in note for note in run.notes())


@pytest.mark.shared_data
@pytest.mark.parametrize(
    ("options", "named"),
    [
        (TrackOptions(profile="fast"), "fast"),
        (TrackOptions(tracker={"no_such_field": 1}), "no_such_field"),
        (TrackOptions(fusion={"match_max_px": -1.0}), "match_max_px"),
        (TrackOptions(frames={"fit": {"nodes": 2}}), "fit.nodes"),
    ],
)
def test_wrong_option_is_named_before_the_run(shared_data, options, named):
    with pytest.raises(ConfigError, match=named):
        prepare(open_recording(shared_data / "single_dlo3_speed50"), options)
