"""A cell's configuration, with a recording in the cameras' place."""

from __future__ import annotations

import tomllib
from pathlib import Path

import pytest

from motiondlo.bundled import bundled_recording
from motiondlo.errors import RecordingError
from motiondlo_services.cell_config import check_configuration
from motiondlo_services.replay_cell import replay_config, toml_lines

ROOT = Path(__file__).resolve().parents[2]


@pytest.mark.parametrize("name", ["cell.toml", "replay.toml", "simulated.toml"])
def test_all_is_kept_but_cameras_and_what_the_recording_brings(tmp_path: Path, name: str) -> None:
    original = tmp_path / name
    original.write_text((ROOT / "config" / name).read_text(encoding="utf-8"), encoding="utf-8")
    before = tomllib.loads(original.read_text(encoding="utf-8"))
    with replay_config(original, bundled_recording(), 0.5) as config:
        cell = check_configuration(config)
        assert cell.cell.name == before["cell"]["name"]
        assert cell.replay.speed == 0.5
        recording = cell.recording()
        assert recording is not None
        assert recording.path == bundled_recording().resolve()
        assert cell.event_from_rgb().shape == (3, 3)
        after = tomllib.loads(config.read_text(encoding="utf-8"))
        for section in set(before) - {"cameras", "calibration", "replay"}:
            assert after[section] == before[section]
        assert config.parent == tmp_path, "relative paths begin there"
    assert [path.name for path in tmp_path.iterdir()] == [name], "nothing is left"


def test_without_a_configuration_the_defaults_hold() -> None:
    with replay_config(None, bundled_recording(), 1.0) as config:
        assert check_configuration(config).cell.name == "cell1"
    assert not config.exists()


def test_what_is_no_recording_is_refused(tmp_path: Path) -> None:
    with pytest.raises(RecordingError), replay_config(None, tmp_path, 1.0):
        pass


def test_toml_reads_back() -> None:
    document = {"a": {"x": 1, "y": [1.5, 2.0], "z": 'q"\\u', "in": {"n": True, "other key": [["a"], ["b"]]}}, "b": {}}
    assert tomllib.loads("\n".join(toml_lines(document))) == document
