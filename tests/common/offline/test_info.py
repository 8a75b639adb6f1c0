"""The summary of a recording or a bare events file."""

from __future__ import annotations

import json
from pathlib import Path

import cv2
import numpy as np
import pytest
from tests.common.events.encoding import make_triggers, random_events

from motiondlo.errors import RecordingError
from motiondlo.events.types import SensorGeometry
from motiondlo.events.writer import Evt3Writer
from motiondlo.offline.info import summarise

SENSOR = SensorGeometry(640, 480)
FRAME_TIMES_US = (12_000, 62_000, 112_000, 162_000)


def write_events(path: Path) -> None:
    """A tenth of a second, 150 ms of silence, a tenth of a second."""
    events = random_events(20_000, mean_step_us=10.0, width=640, height=480)
    events["t"][10_000:] += 150_000
    edges = [row for t in FRAME_TIMES_US for row in ((t, 0, 1), (t + 5000, 0, 0))]
    with Evt3Writer(path, SENSOR) as writer:
        writer.write(events, make_triggers(edges))


@pytest.fixture
def recording(tmp_path: Path) -> Path:
    write_events(tmp_path / "events.raw")
    (tmp_path / "frames").mkdir()
    manifest = {f"frame_{i:06}.jpg": t for i, t in enumerate(FRAME_TIMES_US, 1)}
    manifest["frame_000009.jpg"] = 777_000  # on disk, but no trigger at that time
    manifest["frame_000010.jpg"] = 888_000  # not on disk
    for name in list(manifest)[:-1]:
        if name != "frame_000002.jpg":
            cv2.imwrite(str(tmp_path / "frames" / name), np.zeros((8, 8, 3), np.uint8))
    (tmp_path / "manifest.json").write_text(json.dumps(manifest))
    (tmp_path / "homography").mkdir()
    np.save(tmp_path / "homography" / "rgb_to_event_H.npy", np.diag([0.5, 0.5, 1.0]))
    info = {"event": {"width": 640, "height": 480}, "rgb": {"width": 1280, "height": 960}}
    (tmp_path / "camera_info.json").write_text(json.dumps(info))
    return tmp_path


def test_a_whole_recording(recording: Path) -> None:
    info = summarise(recording)
    assert (info.format, info.geometry, info.events) == ("EVT3", "640x480", 20_000)
    assert info.duration_s == pytest.approx(0.35, abs=0.01)
    assert info.events_per_s == pytest.approx(20_000 / info.duration_s, abs=1)
    assert info.peak_events_per_s == pytest.approx(1e5, rel=0.1)
    assert (info.gaps, info.longest_gap_ms) == (1, pytest.approx(150, abs=1))
    assert (info.triggers, info.trigger_period_ms, info.triggers_missed) == (8, 50.0, 0)
    assert (info.frames, info.frames_matched, info.frames_without_trigger) == (4, 3, 1)
    assert info.triggers_without_frame == 1
    assert info.frame_rejects == {"frame_missing": 2}
    assert (info.homography, info.ground_truth, info.background) == ("ok", False, False)
    assert info.damage == {}


def test_a_bare_file_has_no_frame_facts(tmp_path: Path) -> None:
    write_events(tmp_path / "events.raw")
    facts = summarise(tmp_path / "events.raw").as_dict()
    assert facts["events"] == 20_000
    assert not {"frames", "homography", "ground_truth"} & facts.keys()
    json.dumps(facts)


def test_damage_is_told(tmp_path: Path) -> None:
    path = tmp_path / "events.raw"
    write_events(path)
    data = path.read_bytes()
    path.write_bytes(data[:20_000] + b"\x00\x90" + data[20_002:] + b"\x01")
    info = summarise(path)
    assert info.damage["reserved_word"] == 1
    assert info.damage["truncated_bytes"] == 1
    assert info.events > 19_900


@pytest.mark.parametrize(
    ("matrix", "words"),
    [
        (np.zeros((3, 3)), "singular"),
        (np.eye(2), "shape"),
        (np.array([[1, 0, 9000], [0, 1, 0], [0, 0, 1.0]]), "implausible"),
    ],
)
def test_a_bad_homography_is_named(recording: Path, matrix: np.ndarray, words: str) -> None:
    np.save(recording / "homography" / "rgb_to_event_H.npy", matrix)
    assert words in (summarise(recording).homography or "")


def test_no_homography_is_told(recording: Path) -> None:
    (recording / "homography" / "rgb_to_event_H.npy").unlink()
    assert summarise(recording).homography == "none"


def test_what_does_not_exist_is_named(tmp_path: Path) -> None:
    with pytest.raises(RecordingError, match="nothing"):
        summarise(tmp_path / "nothing")
    with pytest.raises(RecordingError, match=r"events\.raw"):
        summarise(tmp_path)


def test_an_empty_file_gives_zeros(tmp_path: Path) -> None:
    path = tmp_path / "events.raw"
    path.write_bytes(b"% evt 3.0\n% end\n")
    info = summarise(path)
    assert (info.events, info.duration_s, info.events_per_s) == (0, 0.0, 0.0)
