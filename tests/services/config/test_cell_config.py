"""The configurations that are shipped are valid and complete; wrong ones are refused by name."""

from __future__ import annotations

from pathlib import Path

import pytest

from motiondlo.errors import ConfigError
from motiondlo_services.cell_config import SECTIONS, check_configuration
from motiondlo_services.processes import PROCESSES
from motiondlo_services.reference import reference_configuration
from motiondlo_services.replay_cell import write_replay_cell

CONFIG = Path(__file__).resolve().parents[3] / "config"


@pytest.mark.parametrize("path", sorted(CONFIG.glob("*.toml")), ids=lambda path: path.name)
def test_shipped_configurations_are_valid(path: Path) -> None:
    check_configuration(path)


def test_the_reference_is_current() -> None:
    current = (CONFIG / "reference.toml").read_text(encoding="utf-8")
    assert current == reference_configuration(), "python -m motiondlo_services.reference > config/reference.toml"


def test_every_daemon_has_its_section() -> None:
    assert {row.section for row in PROCESSES} <= set(SECTIONS)


@pytest.mark.parametrize(
    ("text", "parts"),
    [
        ("[fusoin]\n", ["[fusoin]", "no such section"]),
        ("[event_ingest]\nbatch_us = 10\n", ["[event_ingest]", "batch_us = 10", "200"]),
        ('[event_tracker]\nprofile = "best"\n', ["profile", "'best'", "default"]),
        ("[event_tracker.parameters]\noutput_nodes = -3\n", ["[event_tracker.parameters]", "output_nodes = -3"]),
        ("[event_tracker.parameters]\nnonsense = 1\n", ["nonsense", "no such field"]),
        ('[bus.endpoints]\nsegmentor = "tcp/127.0.0.1:9000"\n', ["segmentor"]),
        ("[segmenter.fit]\nnodes = 2\n", ["[segmenter]", "fit.nodes = 2"]),
    ],
)
def test_what_is_wrong_is_named(tmp_path: Path, text: str, parts: list[str]) -> None:
    path = tmp_path / "cell.toml"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(ConfigError) as error:
        check_configuration(path)
    for part in [str(path), *parts]:
        assert part in str(error.value)


def test_a_replay_cell_keeps_what_it_is_given(tmp_path: Path) -> None:
    from motiondlo.bundled import bundled_recording

    path = write_replay_cell(
        tmp_path / "c.toml", bundled_recording(), "x", {"replay": {"speed": 0.5}, "fusion": {"lead_ms": 3.0}}
    )
    cell = check_configuration(path)
    assert cell.cell.name == "x"
    assert cell.replay.speed == 0.5
    recording = cell.recording()
    assert recording is not None
    assert len(recording.frames) == 12
    assert cell.px_per_mm() is not None
