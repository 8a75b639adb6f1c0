from __future__ import annotations

import json

import numpy as np
import pytest

from motiondlo.cli.main import main


@pytest.fixture
def recording(tmp_path):
    """A folder with the truth of one straight DLO that moves down, and tracks that are 1 mm beside it."""
    times_us = np.arange(0, 100_001, 1000)
    nodes = np.empty((1, len(times_us), 20, 2), np.float32)
    nodes[..., 0] = np.linspace(300.0, 700.0, 20)
    nodes[..., 1] = (100.0 + times_us / 1000.0)[None, :, None]
    np.savez(
        tmp_path / "ground_truth.npz",
        times_us=times_us,
        nodes=nodes,
        visibility=np.zeros(nodes.shape[:3], np.uint8),
        moving=np.ones((1, len(times_us)), bool),
        moved=np.ones(1, bool),
        speed_mm_s=np.full((1, len(times_us)), 200.0, np.float32),
        px_per_mm=np.float64(5.0),
        names=np.array(["hose"]),
    )
    np.savez(tmp_path / "tracks.npz", times_us=times_us, nodes=nodes[0] + np.array([0.0, 5.0], np.float32))
    return tmp_path


def test_table_json_and_page(recording, capsys):
    argv = ["eval", str(recording), "--tracks", str(recording / "tracks.npz")]
    argv += ["--json", str(recording / "e.json"), "--html", str(recording / "e.html")]
    assert main(argv) == 0
    out = capsys.readouterr().out
    assert "hose" in out
    assert "1.00" in out
    entry = json.loads((recording / "e.json").read_text())["moved"][0]
    assert (entry["name"], entry["id"], entry["ptc_mm"]["mean"], entry["nees"]) == ("hose", 0, 1.0, None)
    assert (recording / "e.html").read_text().startswith("<!doctype html>")


def test_quiet_prints_nothing(recording, capsys):
    assert main(["eval", str(recording), "--tracks", str(recording / "tracks.npz"), "--quiet"]) == 0
    assert capsys.readouterr() == ("", "")


def test_absent_truth_absent_tracks_and_a_place_that_cannot_be_written(recording, tmp_path_factory, capsys):
    empty = tmp_path_factory.mktemp("empty")
    assert main(["eval", str(empty), "--tracks", str(recording / "tracks.npz")]) == 1
    assert "ground_truth.npz" in capsys.readouterr().err
    assert main(["eval", str(recording), "--tracks", str(empty / "tracks.npz")]) == 1
    assert "motiondlo track" in capsys.readouterr().err
    argv = ["eval", str(recording), "--tracks", str(recording / "tracks.npz"), "--json", str(empty / "no" / "e.json")]
    assert main(argv) == 1
    assert "no folder" in capsys.readouterr().err
