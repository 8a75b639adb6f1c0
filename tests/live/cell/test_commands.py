"""Commands to a running cell: reset, pause and resume, seen in the state."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from motiondlo.bus.session import open_bus
from motiondlo_services.cell_config import bus_section
from motiondlo_services.live_run import LiveRun, play
from motiondlo_services.supervisor import Supervisor

pytestmark = pytest.mark.live


class Commander:
    """Resets once the cell is up, pauses when the DLO is back under its new id, and resumes when that was said."""

    def __init__(self, config: Path) -> None:
        self.steps: list[str] = []
        self.answers: list[object] = []
        self._client = bus_section(config).of_client("test", "fusion")

    def __call__(self, supervisor: Supervisor, run: LiveRun) -> None:
        """To be called all the time."""
        newest = run.states[-1] if run.states else None
        ids = [] if newest is None else [dlo.id for dlo in newest.dlos]
        wanted = {0: ("reset", ids == [0]), 1: ("pause", ids == [1]), 2: ("resume", self._degraded(run))}
        verb, now = wanted.get(len(self.steps), ("", False))
        if now:
            with open_bus(self._client, "commander") as bus:
                (answer,) = bus.ask(verb, target="fusion", timeout_s=5.0)  # type: ignore[arg-type]
            self.steps.append(verb)
            self.answers.append(answer.result)

    def _degraded(self, run: LiveRun) -> bool:
        return run.states[-1].mode == "DEGRADED" if run.states else False


def test_a_cell_is_reset_paused_and_resumed(make_cell: Callable[..., Path]) -> None:
    config = make_cell(replay={"speed": 0.03, "segmenter_latency_ms": 20.0})
    commander = Commander(config)
    run = play(config, time_limit_s=110.0, on_step=commander)
    assert commander.steps == ["reset", "pause", "resume"]
    assert commander.answers == [{"retired": (0,)}, {"paused": True}, {"paused": False}]
    assert run.states[-1].mode != "DEGRADED"
    assert [dlo.id for dlo in run.states[-1].dlos] == [1], "ids are not used again"
    assert set(run.restarts.values()) == {0}
