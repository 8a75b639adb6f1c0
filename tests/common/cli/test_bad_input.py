"""What a user gets for a damaged recording or a wrong option: a clear answer, and nothing lost that is good."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from motiondlo.bundled import bundled_recording
from motiondlo.cli.main import main
from motiondlo.offline.tracks import load_tracks
from motiondlo.recording.cropping import crop_recording


@pytest.fixture(scope="module")
def short_recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The first 0.2 s of the bundled recording: at rest, then the first of the motion."""
    path = tmp_path_factory.mktemp("short") / "recording"
    crop_recording(bundled_recording(), path, 0, 200_000)
    return path


@pytest.fixture
def recording(short_recording: Path, tmp_path: Path) -> Path:
    """A copy to damage."""
    path = tmp_path / "recording"
    crop_recording(short_recording, path, 0, 200_000)
    return path


def track(recording: Path, out: Path, *options: str) -> int:
    return main(["track", str(recording), "--out", str(out), *options])


def test_TRUNCATED_events_give_every_estimate_before_the_end(recording: Path, tmp_path: Path) -> None:
    events = recording / "events.raw"
    whole = events.read_bytes()
    events.write_bytes(whole[: int(0.6 * len(whole))])
    assert track(recording, tmp_path / "t.npz") == 0
    times_us = load_tracks(tmp_path / "t.npz").times_us
    assert 20_000 < times_us[-1] < 200_000
    assert (np.diff(times_us) > 0).all()


def test_CORRUPTED_events_are_skipped_and_times_stay_true(recording: Path, tmp_path: Path) -> None:
    events = recording / "events.raw"
    data = bytearray(events.read_bytes())
    middle = len(data) // 2
    data[middle : middle + 4000] = np.random.default_rng(1).bytes(4000)
    events.write_bytes(bytes(data))
    assert track(recording, tmp_path / "t.npz") == 0
    times_us = load_tracks(tmp_path / "t.npz").times_us
    assert (np.diff(times_us) > 0).all()
    assert 190_000 <= times_us[-1] <= 210_000


def test_events_of_an_unknown_format_fail_with_one_line(
    recording: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (recording / "events.raw").write_bytes(b"\x89PNG\r\n\x1a\n" + bytes(1000))
    assert track(recording, tmp_path / "t.npz") == 1
    lines = capsys.readouterr().err.strip().splitlines()
    assert len(lines) == 1
    assert "events.raw" in lines[0]


def test_a_missing_first_frame_is_passed_over(recording: Path, tmp_path: Path) -> None:
    first = min((recording / "frames").iterdir())
    first.unlink()
    assert track(recording, tmp_path / "t.npz") == 0
    assert load_tracks(tmp_path / "t.npz").known_ids() == (0,)


@pytest.mark.parametrize("damage", ["absent", "singular", "shape"])
def test_a_homography_that_cannot_be_used_fails_before_the_start(
    recording: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], damage: str
) -> None:
    path = recording / "homography" / "rgb_to_event_H.npy"
    if damage == "absent":
        path.unlink()
    else:
        np.save(path, np.zeros((3, 3)) if damage == "singular" else np.eye(2))
    assert track(recording, tmp_path / "t.npz") == 1
    assert "rgb_to_event_H.npy" in capsys.readouterr().err
    assert not (tmp_path / "t.npz").exists()


def test_the_event_branch_alone_needs_no_homography(recording: Path, tmp_path: Path) -> None:
    (recording / "homography" / "rgb_to_event_H.npy").unlink()
    assert track(recording, tmp_path / "t.npz", "--mode", "event") == 0
    assert len(load_tracks(tmp_path / "t.npz")) >= 10, "the moving DLO was found in the events alone"


@pytest.mark.parametrize(
    ("assignment", "complaint"),
    [
        ("tracker.output_nodes=-1", "output_nodes = -1"),
        ("tracker.nonsense=1", "nonsense"),
        ("nowhere.x=1", "nowhere.x"),
        ("fusion.lead_ms", "fusion.lead_ms"),
    ],
)
def test_a_wrong_option_is_named(
    recording: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], assignment: str, complaint: str
) -> None:
    assert track(recording, tmp_path / "t.npz", "--set", assignment) == 1
    assert complaint in capsys.readouterr().err
