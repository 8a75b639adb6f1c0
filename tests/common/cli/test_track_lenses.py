"""``motiondlo track`` with lens and plane files, on the bundled recording."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

import motiondlo
from motiondlo.cli.main import main
from motiondlo.geometry.camera_map import CameraMap, map_points, map_points_back
from motiondlo.geometry.lens import load_lens
from motiondlo.recording.layout import open_recording

RECORDING = Path(motiondlo.__file__).parent / "bundled" / "recording"


def lens_file(path: Path, size: tuple[int, int], k1: float) -> Path:
    width, height = size
    matrix = [[1.05 * width, 0.0, 0.5 * width], [0.0, 1.05 * width, 0.5 * height], [0.0, 0.0, 1.0]]
    document = {"width": width, "height": height, "camera_matrix": matrix, "distortion": [k1, 0.0, 0.0, 0.0]}
    path.write_text(json.dumps(document))
    return path


def first_nodes(out: Path, *more: str) -> dict[str, np.ndarray]:
    argv = ["track", str(RECORDING), "--out", str(out), "--mode", "frame", "--update-us", "100000", "--quiet"]
    assert main([*argv, *more]) == 0
    with np.load(out) as file:
        return {key: file[key][0] for key in ("nodes", *(("nodes_mm",) if "nodes_mm" in file else ()))}


def test_shapes_go_through_both_lenses_and_onto_the_plane(tmp_path: Path) -> None:
    recording = open_recording(RECORDING)
    info = recording.camera_info
    assert info.rgb is not None
    assert info.event is not None
    rgb = lens_file(tmp_path / "rgb.json", (info.rgb.width, info.rgb.height), -0.08)
    event = lens_file(tmp_path / "event.json", (info.event.width, info.event.height), 0.05)
    plane = tmp_path / "plane.json"
    plane.write_text('{"px_per_mm": 5.0}')

    plain = first_nodes(tmp_path / "plain.npz")
    assert "nodes_mm" not in plain
    lenses = ["--rgb-lens", str(rgb), "--event-lens", str(event), "--work-plane", str(plane)]
    bent = first_nodes(tmp_path / "bent.npz", *lenses)

    matrix = recording.event_from_rgb()
    through = CameraMap(matrix, load_lens(rgb), load_lens(event))
    nodes_rgb = map_points_back(plain["nodes"].astype(np.float64), matrix)
    np.testing.assert_allclose(bent["nodes"], map_points(nodes_rgb, through), atol=0.1)
    assert np.hypot(*(bent["nodes"] - plain["nodes"]).T).max() > 1.0
    ideal = load_lens(event).undistorted(bent["nodes"].astype(np.float64))
    np.testing.assert_allclose(bent["nodes_mm"], ideal / 5.0, atol=1e-3)


def test_a_lens_of_another_size_is_one_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    wrong = lens_file(tmp_path / "rgb.json", (640, 480), -0.05)
    argv = ["track", str(RECORDING), "--out", str(tmp_path / "t.npz"), "--rgb-lens", str(wrong)]
    assert main(argv) == 1
    err = capsys.readouterr().err
    assert "640x480" in err
    assert err.count("\n") == 1
    assert not (tmp_path / "t.npz").exists()
