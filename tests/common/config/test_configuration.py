"""A wrong configuration names the file, the field, the value and the bound."""

from __future__ import annotations

from pathlib import Path

import pytest

from motiondlo.config.cell import load_cell
from motiondlo.config.loader import load_section
from motiondlo.config.validation import parse_assignment, validated
from motiondlo.errors import ConfigError
from motiondlo.fusion.params import FusionParams


def write(path: Path, text: str) -> Path:
    path.write_text(text, encoding="utf-8")
    return path


def test_absent_sections_have_their_defaults(tmp_path: Path) -> None:
    cell = load_cell(write(tmp_path / "c.toml", ""))
    assert cell.cell.name == "cell"
    assert cell.geometry.width_px == 1280
    assert cell.recording() is None


@pytest.mark.parametrize(
    ("text", "parts"),
    [
        (
            "[fusion]\nstatic_after_ms = -1.0",
            ["c.toml", "[fusion]", "static_after_ms", "-1.0", "greater than or equal to 1"],
        ),
        ("[fusion]\nstatic_after = 1.0", ["c.toml", "static_after", "no such field"]),
        ('[fusion]\nbirth_confirmations = "two"', ["birth_confirmations", "'two'", "integer"]),
        ("[fusion\n", ["c.toml", "not valid TOML"]),
        ("fusion = 3", ["c.toml", "fusion is no table"]),
    ],
    ids=["bound", "unknown", "type", "syntax", "no table"],
)
def test_wrong_values_are_named(tmp_path: Path, text: str, parts: list[str]) -> None:
    with pytest.raises(ConfigError) as error:
        load_section(write(tmp_path / "c.toml", text), "fusion", FusionParams)
    for part in parts:
        assert part in str(error.value)


def test_a_missing_file_is_named(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"nowhere\.toml"):
        load_cell(tmp_path / "nowhere.toml")


def test_a_cell_name_that_would_break_topics_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="name"):
        load_cell(write(tmp_path / "c.toml", '[cell]\nname = "a/b"'))


def test_paths_start_at_the_configuration_file(tmp_path: Path) -> None:
    (tmp_path / "sub").mkdir()
    cell = load_cell(write(tmp_path / "sub" / "c.toml", '[replay]\nrecording = "../rec"'))
    assert cell.resolve(cell.replay.recording) == (tmp_path / "rec").resolve()


@pytest.mark.parametrize(
    ("text", "value"), [("a.b=3", 3), ("a.b=0.5", 0.5), ("a.b=true", True), ("a.b=paper", "paper")]
)
def test_assignments_keep_their_type(text: str, value: object) -> None:
    assert parse_assignment(text) == ("a.b", value)


def test_an_assignment_without_a_value_is_refused() -> None:
    with pytest.raises(ConfigError, match="key=value"):
        parse_assignment("a.b")


def test_all_wrong_fields_are_named_at_once() -> None:
    with pytest.raises(ConfigError) as error:
        validated(FusionParams, {"lead_ms": -1.0, "nonsense": 1}, "--set")
    assert "lead_ms" in str(error.value)
    assert "nonsense" in str(error.value)
