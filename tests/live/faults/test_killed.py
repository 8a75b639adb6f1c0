"""KILLED: every daemon in turn, with SIGKILL, while the DLO moves."""

from __future__ import annotations

import os
import signal
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

from motiondlo.bundled import bundled_recording
from motiondlo.messages.state import StateMessage
from motiondlo.offline.options import TrackOptions
from motiondlo.offline.run_track import track_recording
from motiondlo.recording.layout import open_recording
from motiondlo_services.live_run import LiveRun, play
from motiondlo_services.processes import PROCESSES
from motiondlo_services.supervisor import Supervisor

pytestmark = pytest.mark.live

SPEED = 0.02
"""The DLO moves at 1.2 m/s in the recording, for 0.4 s: 20 s here."""
PAUSE_S = 2.5
BACK_AGAIN_S = 1.0
"""0.2 to 0.4 s on average, 0.8 at most on a very busy machine; a daemon that had to load from the start took 2 s."""
VICTIMS = tuple(row.name for row in PROCESSES if row.in_mesh)
BESIDES = ("frame-capture", "segmenter")
"""The event path does not need them."""


@dataclass(frozen=True)
class Kill:
    """One SIGKILL."""

    victim: str
    pid: int
    at_ns: int


class Killer:
    """Kills one daemon after the other, with pauses, from the first motion on."""

    def __init__(self, victims: tuple[str, ...]) -> None:
        self.kills: list[Kill] = []
        self._victims = list(victims)
        self._next_s = float("inf")

    def __call__(self, supervisor: Supervisor, run: LiveRun) -> None:
        """To be called all the time."""
        now_s = time.monotonic()
        if self._next_s == float("inf") and run.states and run.states[-1].mode == "MOTION":
            self._next_s = now_s + 0.5
        if now_s < self._next_s or not self._victims:
            return
        child = supervisor.children[self._victims[0]]
        if child.pid is None or (child.row.standby and child.standby is None):
            return
        os.kill(child.pid, signal.SIGKILL)
        self.kills.append(Kill(self._victims.pop(0), child.pid, time.monotonic_ns()))
        self._next_s = now_s + PAUSE_S


def longest_silence_s(states: list[StateMessage], kill: Kill) -> float:
    """Between two states from the kill until the next one."""
    times_ns = [state.t_sent_ns for state in states]
    until_ns = kill.at_ns + int(PAUSE_S * 1e9)
    last_before_ns = max(t for t in times_ns if t <= kill.at_ns)
    times_ns = [last_before_ns, *(t for t in times_ns if kill.at_ns < t < until_ns)]
    return float(np.diff(times_ns).max()) * 1e-9


def test_KILLED_daemons_come_back_in_motion_and_nothing_else_notices(
    make_cell: Callable[..., Path], fault_rounds: int
) -> None:
    truth = track_recording(open_recording(bundled_recording()), TrackOptions())
    for _ in range(fault_rounds):
        killer = Killer(VICTIMS)
        run = play(make_cell(speed=SPEED), time_limit_s=110.0, on_step=killer)
        assert [kill.victim for kill in killer.kills] == list(VICTIMS), "the motion ended too early"
        assert run.restarts == {row.name: int(row.in_mesh) for row in PROCESSES if row.name in run.restarts}
        assert not [line for line in run.events if "had to be killed" in line]
        for kill in killer.kills:
            limit_s = 0.4 if kill.victim in BESIDES else BACK_AGAIN_S
            assert longest_silence_s(run.states, kill) < limit_s, kill.victim
        assert all([dlo.id for dlo in state.dlos] == [0] for state in run.states), "the same DLO all the time"
        after = [state for state in run.states if state.t_sent_ns > killer.kills[-1].at_ns]
        assert after[-1].t_us > truth.times_us[-1] - 20_000, "to the recording's end"
        distance_px = [np.abs(nodes_at(truth, state.t_us) - state.dlos[0].nodes).mean() for state in after]
        assert np.median(distance_px) < 10.0, "and it is where it would have been"


def nodes_at(tracks: object, t_us: int) -> np.ndarray:
    """(M, 2) of the run that nothing happened to."""
    times_us, nodes = tracks.times_us, tracks.nodes  # type: ignore[attr-defined]
    return np.asarray(nodes[int(np.abs(times_us - t_us).argmin())])
