"""Synthetic ground truth whose metrics can be worked out by hand."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from motiondlo.offline.ground_truth import GroundTruth
from motiondlo.offline.tracks import Tracks, make_tracks

PX_PER_MM = 5.0
NODES = 100
STEP_US = 1000


def straight_truth(
    speeds_px_ms: tuple[float, ...] = (2.0,),
    duration_ms: int = 200,
    hidden_first: int = 0,
    hidden_last: int = 0,
) -> GroundTruth:
    """Straight horizontal DLOs from x = 300 to x = 696, 60 px apart, each moving down at its own speed throughout."""
    count = len(speeds_px_ms)
    times_us = np.arange(0, duration_ms + 1, dtype=np.int64) * STEP_US
    nodes = np.empty((count, len(times_us), NODES, 2), np.float32)
    nodes[..., 0] = 300.0 + 4.0 * np.arange(NODES)
    for k, speed in enumerate(speeds_px_ms):
        nodes[k, ..., 1] = (100.0 + 60.0 * k + speed * times_us / 1000.0)[:, None]
    visibility = np.zeros((count, len(times_us), NODES), np.uint8)
    visibility[..., :hidden_first] = 2
    visibility[..., NODES - hidden_last :] = 4
    moving = np.repeat(np.array(speeds_px_ms)[:, None] != 0.0, len(times_us), axis=1)
    return GroundTruth(
        times_us=times_us,
        nodes=nodes,
        visibility=visibility,
        moving=moving,
        moved=moving.any(axis=1),
        speed_mm_s=np.repeat(np.abs(speeds_px_ms)[:, None] * 1000.0 / PX_PER_MM, len(times_us), axis=1).astype("f4"),
        px_per_mm=PX_PER_MM,
        names=tuple(f"dlo{k}" for k in range(count)),
        width_px=1280,
        height_px=720,
    )


def tracks_from_truth(
    truth: GroundTruth,
    ids: tuple[int, ...] | None = None,
    every: int = 1,
    offset_px: tuple[float, float] = (0.0, 0.0),
    stale_ms: int = 0,
    sigma_px: float = 1.0,
    reverse: bool = False,
) -> Tracks:
    """The truth as tracks: displaced by an offset, or showing the DLOs as they were ``stale_ms`` ago."""
    ids = tuple(range(truth.count)) if ids is None else ids
    index = np.arange(0, len(truth.times_us), every)
    shown = np.maximum(index - stale_ms * 1000 // STEP_US, 0)
    nodes = truth.nodes[:, shown].transpose(1, 0, 2, 3).reshape(-1, NODES, 2) + np.array(offset_px, np.float32)
    return make_tracks(
        np.repeat(truth.times_us[index], truth.count),
        nodes[:, ::-1] if reverse else nodes,
        ids=np.tile(np.array(ids), len(index)),
        sigma_px=np.full(nodes.shape[:2], sigma_px, np.float32),
    )


@pytest.fixture
def make_truth() -> Callable[..., GroundTruth]:
    """:func:`straight_truth`."""
    return straight_truth


@pytest.fixture
def as_tracks() -> Callable[..., Tracks]:
    """:func:`tracks_from_truth`."""
    return tracks_from_truth


@pytest.fixture
def excerpt(shared_data: Path, tmp_path: Path) -> Callable[..., Path]:
    """Makes the beginning of a recording as a recording of its own."""

    def make(name: str = "single_dlo3_speed50", event_bytes: int = 600_000, frames: int = 3) -> Path:
        """The beginning of a recording: some bytes of its events, and its first frames."""
        source, target = shared_data / name, tmp_path / f"{name}_{event_bytes}_{frames}"
        (target / "frames").mkdir(parents=True)
        shutil.copytree(source / "homography", target / "homography")
        for file in ("camera_info.json", "background.jpg"):
            shutil.copy(source / file, target / file)
        (target / "events.raw").write_bytes((source / "events.raw").read_bytes()[:event_bytes])
        manifest = dict(list(json.loads((source / "manifest.json").read_text()).items())[:frames])
        (target / "manifest.json").write_text(json.dumps(manifest))
        for frame in manifest:
            shutil.copy(source / "frames" / frame, target / "frames" / frame)
        return target

    return make
