from __future__ import annotations

import json

import pytest

from motiondlo.cli.main import main
from motiondlo.offline.tracks import load_tracks


@pytest.mark.shared_data
def test_track_then_eval(shared_data, tmp_path, capsys):
    recording, tracks = str(shared_data / "single_dlo3_speed50"), tmp_path / "tracks.npz"
    argv = ["track", recording, "--out", str(tracks), "--mode", "frame", "--update-us", "10000"]
    assert main(argv) == 0
    assert "1 DLO" in capsys.readouterr().out
    assert set(load_tracks(tracks).source) == {"frame"}
    assert main(["eval", recording, "--tracks", str(tracks), "--json", str(tmp_path / "e.json"), "--quiet"]) == 0
    (moved,) = json.loads((tmp_path / "e.json").read_text())["moved"]
    # Held for a second, the first frame's shape is no estimate of a cable that moves at 900 mm/s.
    assert moved["lost_fraction"] > 0.5
    assert moved["rate_hz"] == pytest.approx(100.0, rel=0.1)


@pytest.mark.shared_data
def test_wrong_parameter_is_one_line(shared_data, tmp_path, capsys):
    argv = ["track", str(shared_data / "single_dlo3_speed50"), "--out", str(tmp_path / "t.npz")]
    assert main([*argv, "--set", "fusion.match_max_px=-3"]) == 1
    err = capsys.readouterr().err
    assert "match_max_px = -3" in err
    assert err.count("\n") == 1
    assert not (tmp_path / "t.npz").exists()
