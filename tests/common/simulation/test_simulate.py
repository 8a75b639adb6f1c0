"""A simulated recording is a recording, its truth is true, and it repeats itself."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from motiondlo.errors import MotionDLOError
from motiondlo.events.reader import open_events
from motiondlo.offline.ground_truth import load_ground_truth
from motiondlo.recording.layout import open_recording
from motiondlo.simulation.scene import SceneParams
from motiondlo.simulation.simulate import simulate_recording

pytest.importorskip("mujoco", reason="needs the extra motiondlo[simulate]")


@pytest.fixture(scope="module")
def folder(short_scene: SceneParams, tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("simulated") / "short"
    simulate_recording("short", short_scene, 1, out)
    return out


def test_it_opens_as_a_recording(folder: Path) -> None:
    recording = open_recording(folder)
    np.testing.assert_allclose([frame.t_us for frame in recording.frames], [12000, 62000, 112000], atol=3)
    assert recording.camera_info.px_per_mm == pytest.approx(5.4, abs=0.01)
    assert recording.background() is not None
    assert recording.event_from_rgb().shape == (3, 3)
    assert not recording.rejects


def test_triggers_frame_the_exposures(folder: Path) -> None:
    triggers = np.concatenate([part for _, part, _ in open_events(folder / "events.raw").chunks()])
    starts = [frame.t_us for frame in open_recording(folder).frames]
    assert triggers["t"][triggers["edge"] == 1].tolist() == starts
    assert triggers["t"][triggers["edge"] == 0].tolist() == [start + 5000 for start in starts]


def test_events_come_from_where_the_truth_moves(folder: Path) -> None:
    truth = load_ground_truth(folder / "ground_truth.npz")
    events = np.concatenate([part for part, _, _ in open_events(folder / "events.raw").chunks()])
    before = events[events["t"] < 50000]
    assert len(before) / 0.05 == pytest.approx(0.12 * 1280 * 720 + 25 * 400, rel=0.1)
    assert not truth.moving[0, :55].any()
    at = int(np.argmax(truth.speed_mm_s[0])) * 1000
    slice_ = events[(events["t"] >= at - 500) & (events["t"] < at + 500)]
    image = np.zeros((720, 1280), np.float32)
    np.add.at(image, (slice_["y"], slice_["x"]), 1.0)
    nodes = truth.nodes_at(0, np.array([at]))[0][15:-5]
    step = np.gradient(nodes, axis=0)
    normal = np.stack([-step[:, 1], step[:, 0]], axis=1) / np.hypot(*step.T)[:, None]
    # Both edges fire, half a diameter from the centreline, shifted by the way of at most a millisecond.
    offsets = np.arange(-40.0, 41.0)
    places = nodes[:, None] + offsets[None, :, None] * normal[:, None]
    profile = cv2.remap(image, places[..., 0].astype(np.float32), places[..., 1].astype(np.float32), 1).sum(axis=0)
    inner = profile[np.abs(offsets) < 24]
    assert inner.sum() > 0.75 * profile.sum()


def test_frames_show_the_cable_where_the_truth_is(folder: Path) -> None:
    truth = load_ground_truth(folder / "ground_truth.npz")
    frame = cv2.imread(str(folder / "frames" / "frame_000001.jpg")).astype(float)
    board = cv2.imread(str(folder / "background.jpg")).astype(float)
    with np.load(folder / "ground_truth.npz") as archive:
        h = np.linalg.inv(archive["H_true"])
    nodes = cv2.perspectiveTransform(truth.nodes_at(0, np.array([14000]))[0][None], h)[0]
    x, y = nodes[20:-5].round().astype(int).T
    assert (np.abs(frame - board).max(axis=2)[y, x] > 40).all()


def test_the_same_seed_gives_the_same_files(short_scene: SceneParams, folder: Path, tmp_path: Path) -> None:
    simulate_recording("short", short_scene, 1, tmp_path / "again")
    for name in ("events.raw", "manifest.json", "frames/frame_000002.jpg", "background.jpg", "scene.json"):
        assert (tmp_path / "again" / name).read_bytes() == (folder / name).read_bytes(), name


def test_a_folder_that_holds_something_is_refused(short_scene: SceneParams, folder: Path) -> None:
    with pytest.raises(MotionDLOError, match="is not empty"):
        simulate_recording("short", short_scene, 1, folder)
