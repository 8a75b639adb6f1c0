"""Recordings with missing and damaged parts."""

from __future__ import annotations

import json
from pathlib import Path

import cv2
import numpy as np
import pytest

from motiondlo.errors import CalibrationError, RecordingError
from motiondlo.recording.layout import open_recording, read_image
from motiondlo.rejects import RejectReason


def make_recording(folder: Path, manifest: object, frames: tuple[str, ...]) -> Path:
    (folder / "frames").mkdir(parents=True)
    (folder / "events.raw").write_bytes(b"")
    for name in frames:
        cv2.imwrite(str(folder / "frames" / name), np.full((8, 8, 3), 99, np.uint8))
    (folder / "manifest.json").write_text(json.dumps(manifest), encoding="utf-8")
    return folder


def test_frames_come_in_the_order_of_their_triggers(tmp_path: Path) -> None:
    path = make_recording(tmp_path / "r", {"b.jpg": 10, "a.jpg": 60}, ("a.jpg", "b.jpg"))
    recording = open_recording(path)
    assert [(f.name, f.t_us) for f in recording.frames] == [("b.jpg", 10), ("a.jpg", 60)]
    assert recording.rejects == {}


def test_missing_frames_and_bad_entries_are_counted_and_the_rest_is_used(tmp_path: Path) -> None:
    manifest = {"a.jpg": 10, "gone.jpg": 60, "neg.jpg": -1, "text.jpg": "soon", "../evil.jpg": 5}
    path = make_recording(tmp_path / "r", manifest, ("a.jpg", "neg.jpg", "text.jpg", "extra.jpg"))
    recording = open_recording(path)
    assert [f.name for f in recording.frames] == ["a.jpg"]
    assert recording.rejects == {RejectReason.FRAME_MISSING: 1, RejectReason.FRAME_WITHOUT_TRIGGER: 4}


def test_a_folder_without_events_is_no_recording(tmp_path: Path) -> None:
    with pytest.raises(RecordingError, match=r"has no events\.raw"):
        open_recording(tmp_path)
    with pytest.raises(RecordingError, match="no such folder"):
        open_recording(tmp_path / "nowhere")


@pytest.mark.parametrize("text", ["{", "[1, 2]"], ids=["truncated", "no object"])
def test_an_unreadable_manifest_is_named(tmp_path: Path, text: str) -> None:
    path = make_recording(tmp_path / "r", {}, ())
    (path / "manifest.json").write_text(text, encoding="utf-8")
    with pytest.raises(RecordingError, match=r"manifest\.json"):
        open_recording(path)


def test_camera_info_names_the_wrong_field(tmp_path: Path) -> None:
    path = make_recording(tmp_path / "r", {}, ())
    (path / "camera_info.json").write_text('{"px_per_mm": -1, "other": 3}', encoding="utf-8")
    with pytest.raises(RecordingError, match="px_per_mm"):
        open_recording(path)


def test_a_jpeg_that_was_cut_short_is_not_read(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    path = tmp_path / "f.jpg"
    cv2.imwrite(str(path), rng.integers(0, 255, (64, 64, 3), dtype=np.uint8))
    assert read_image(path) is not None
    path.write_bytes(path.read_bytes()[:-700])
    assert read_image(path) is None
    assert read_image(tmp_path / "nowhere.jpg") is None


@pytest.mark.parametrize(
    ("matrix", "complaint"),
    [
        (None, "no such file"),
        (np.zeros((3, 3)), "singular"),
        (np.eye(4), "shape"),
        (np.full((3, 3), np.nan), "not finite"),
    ],
    ids=["absent", "singular", "wrong shape", "nan"],
)
def test_a_homography_that_cannot_be_used_is_refused(tmp_path: Path, matrix: np.ndarray | None, complaint: str) -> None:
    path = make_recording(tmp_path / "r", {}, ())
    if matrix is not None:
        (path / "homography").mkdir()
        np.save(path / "homography" / "rgb_to_event_H.npy", matrix)
    with pytest.raises(CalibrationError, match=complaint):
        open_recording(path).event_from_rgb()
