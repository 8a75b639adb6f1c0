"""A recording written piece by piece reads like what was put in."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from tests.common.events.encoding import make_events, make_triggers

from motiondlo.errors import RecordingError
from motiondlo.events.reader import read_all
from motiondlo.events.types import EventBatch, SensorGeometry, TriggerArray, empty_triggers
from motiondlo.recording.layout import open_recording, read_image
from motiondlo.recording.writer import FRAMES_WAITING, RecordingWriter

SENSOR = SensorGeometry(320, 240)
T0_US = 7_000_000_000
"""Of a cell that has run for two hours: more than the 24 bits of the camera's time words."""


def batch(k: int, *offsets_us: int, lost: int = 0, triggers: TriggerArray | None = None) -> EventBatch:
    t0_us = T0_US + 2000 * k
    events = make_events([(t0_us + t, 5, 6, 1) for t in offsets_us])
    return EventBatch(t0_us, t0_us + 2000, events, empty_triggers() if triggers is None else triggers, lost)


def test_it_reads_as_what_was_recorded_from_zero_on(tmp_path: Path) -> None:
    image = np.full((48, 64, 3), 90, np.uint8)
    with RecordingWriter(tmp_path / "r") as writer:
        writer.write_calibration(np.diag([0.5, 0.5, 1.0]), image, {"px_per_mm": 5.0})
        writer.add_frame(image, T0_US)
        writer.add_batch(batch(0, 10, 500, triggers=make_triggers([(T0_US + 300, 0, 1)])), SENSOR)
        writer.add_batch(batch(1), SENSOR)
        writer.add_frame(image, T0_US + 300)
        writer.add_batch(batch(20_000, 1999), SENSOR)
    assert (writer.events, writer.batches, writer.frames, writer.frames_left_out) == (3, 3, 1, 1)
    recording = open_recording(tmp_path / "r")
    events, triggers = read_all(recording.events_path)
    assert events["t"].tolist() == [10, 500, 40_001_999]
    assert triggers["t"].tolist() == [300]
    (frame,) = recording.frames
    assert frame.t_us == 300
    saved = read_image(frame.path)
    assert saved is not None
    assert abs(saved.astype(int) - 90).max() <= 2
    assert recording.camera_info.px_per_mm == 5.0
    assert recording.background() is not None
    np.testing.assert_array_equal(recording.event_from_rgb(), np.diag([0.5, 0.5, 1.0]))
    assert not recording.rejects


def test_BATCHES_LOST_are_counted_and_their_triggers_are_there(tmp_path: Path) -> None:
    with RecordingWriter(tmp_path / "r") as writer:
        writer.add_triggers(make_triggers([(T0_US - 100, 0, 1), (T0_US + 3000, 0, 1), (T0_US + 6500, 0, 0)]))
        writer.add_batch(batch(0, 1), SENSOR)
        writer.add_batch(batch(3, 1, lost=2, triggers=make_triggers([(T0_US + 6500, 0, 0)])), SENSOR)
    assert writer.lost_batches == 2
    _, triggers = read_all(tmp_path / "r" / "events.raw")
    assert triggers["t"].tolist() == [3000, 6500], "each once"


def test_INGEST_RESTARTED_batches_of_a_time_that_was_had_are_not_written_twice(tmp_path: Path) -> None:
    with RecordingWriter(tmp_path / "r") as writer:
        for k in (0, 1, 1, 2):
            writer.add_batch(batch(k, 7), SENSOR)
    assert writer.repeated_batches == 1
    events, _ = read_all(tmp_path / "r" / "events.raw")
    assert events["t"].tolist() == [7, 2007, 4007]


def test_more_frames_than_can_be_encoded_are_left_out_and_counted(tmp_path: Path) -> None:
    image = np.random.default_rng(1).integers(0, 255, (1000, 1000, 3)).astype(np.uint8)
    with RecordingWriter(tmp_path / "r") as writer:
        writer.add_batch(batch(0, 1), SENSOR)
        for k in range(4 * FRAMES_WAITING):
            writer.add_frame(image, T0_US + k)
    assert writer.frames_left_out > 0
    assert writer.frames + writer.frames_left_out == 4 * FRAMES_WAITING
    assert len(open_recording(tmp_path / "r").frames) == writer.frames


def test_KILLED_what_was_saved_is_in_the_manifest(tmp_path: Path) -> None:
    writer = RecordingWriter(tmp_path / "r")
    writer.add_batch(batch(0, 1), SENSOR)
    writer.add_frame(np.zeros((8, 8, 3), np.uint8), T0_US + 5)
    manifest = tmp_path / "r" / "manifest.json"
    for _ in range(1000):
        if manifest.exists():
            break
        writer._saver.join(0.01)  # it goes on; this only waits
    assert json.loads(manifest.read_text()) == {"frame_000001.jpg": 5}
    writer.close()


def test_a_folder_in_use_is_refused(tmp_path: Path) -> None:
    (tmp_path / "something").touch()
    with pytest.raises(RecordingError, match="not empty"):
        RecordingWriter(tmp_path)
