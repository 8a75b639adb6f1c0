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


def test_tracks_are_of_one_recording(recording, capsys):
    assert main(["eval", str(recording), str(recording), "--tracks", str(recording / "tracks.npz")]) == 1
    assert "several" in capsys.readouterr().err


def test_tracks_or_an_ablation_is_asked_for(recording):
    with pytest.raises(SystemExit) as usage:
        main(["eval", str(recording)])
    assert usage.value.code == 2


def test_ablation_table_and_json(recording, capsys, monkeypatch):
    from motiondlo.offline import ablation

    def runs(path, options, components, other):
        yield ablation.Figures(0.1, 0.2, 0.0, 0, 1.0)
        for k, _ in enumerate(components):
            yield ablation.Figures(0.1 + 0.01 * k, 0.2, 0.0, 0, 1.0)
        yield ablation.Figures(3.0, 4.0, 0.5, 1, 9.0)

    monkeypatch.setattr(ablation, "_recording_runs", runs)
    (recording / "events.raw").write_bytes(b"% evt 3.0\n")
    assert main(["eval", str(recording), str(recording), "--ablate", "--json", str(recording / "a.json")]) == 0
    out = capsys.readouterr().out
    assert "gripper patch" in out
    assert "default against paper: ptc 0.10 against 3.00 mm" in out
    document = json.loads((recording / "a.json").read_text())
    assert document["profile"] == "default"
    assert len(document["without"][0]["recordings"]) == 2
    earned = [row["earns_mm"] for row in document["without"]]
    assert earned == sorted(earned, reverse=True)


def test_a_page_needs_tracks(recording, capsys):
    assert main(["eval", str(recording), "--ablate", "--html", str(recording / "e.html")]) == 1
    assert "--html" in capsys.readouterr().err
