"""Cells that play the bundled recording with real processes; they always end with the test."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from motiondlo.bundled import bundled_recording
from motiondlo_services.replay_cell import Scalar, write_replay_cell

Sections = dict[str, dict[str, Scalar]]
MakeCell = Callable[..., Path]


@pytest.fixture
def make_cell(tmp_path: Path) -> MakeCell:
    """Writes a configuration: ``make_cell(recording=..., section={...})``; without a recording, the bundled one.

    Played at a quarter of real speed: a shared machine must not decide what is tested.
    """

    def make(recording: Path | None = None, **sections: dict[str, Scalar]) -> Path:
        merged: Sections = {"replay": {"speed": 0.25, "wait_for_tracker_s": 60.0}}
        for name, values in sections.items():
            merged.setdefault(name, {}).update(values)
        return write_replay_cell(tmp_path / "cell.toml", recording or bundled_recording(), "test", merged)

    return make
