"""The supervisor's restart policy, with fake processes and a clock that is passed in."""

from __future__ import annotations

import itertools
import signal
import subprocess
from pathlib import Path

from motiondlo_services.processes import PROCESSES, Process, process
from motiondlo_services.supervisor import Supervisor, describe_exit


class FakePopen(subprocess.Popen[bytes]):
    """A process that ends when the test says so."""

    def __init__(self) -> None:
        self.pid = 4242
        self.returncode: int | None = None

    def __del__(self, *_: object) -> None:
        pass

    def poll(self) -> int | None:
        return self.returncode

    def terminate(self) -> None:
        self.returncode = 0

    def wait(self, timeout: float | None = None) -> int:
        assert self.returncode is not None
        return self.returncode


class Spawner:
    """Counts what it starts."""

    def __init__(self) -> None:
        self.started: list[tuple[str, FakePopen]] = []

    def __call__(self, row: Process, config: Path) -> FakePopen:
        popen = FakePopen()
        self.started.append((row.name, popen))
        return popen


def test_every_daemon_is_started_once_and_those_of_the_event_path_once_more_to_stand_by() -> None:
    spawner = Spawner()
    supervisor = Supervisor(Path("cell.toml"), PROCESSES, spawner)
    assert supervisor.step(0.0) == []
    assert sorted(name for name, _ in spawner.started) == sorted(row.name for row in PROCESSES)
    for now_s in (1.0, 2.0, 3.0):
        assert supervisor.step(now_s) == []
    again = sorted(name for name, _ in spawner.started[len(PROCESSES) :])
    assert again == ["event-ingest", "event-tracker", "fusion"]


def test_KILLED_daemon_is_followed_by_the_one_that_stood_by() -> None:
    spawner = Spawner()
    supervisor = Supervisor(Path("cell.toml"), (process("fusion"),), spawner)
    for now_s in (0.0, 1.0):
        supervisor.step(now_s)
    child = supervisor.children["fusion"]
    first, second = (popen for _, popen in spawner.started)
    assert (child.popen, child.standby) == (first, second)
    first.returncode = -signal.SIGKILL
    assert supervisor.step(2.0) == ["fusion ended with signal SIGKILL; the one that stood by takes over"]
    assert (child.popen, child.standby, child.restarts) == (second, None, 1)
    supervisor.step(2.5)
    assert len(spawner.started) == 2, "the next one loads when the daemon has settled"
    supervisor.step(3.0)
    assert child.standby is spawner.started[2][1]


def test_KILLED_stand_by_is_replaced_and_a_finished_daemon_needs_none() -> None:
    spawner = Spawner()
    supervisor = Supervisor(Path("cell.toml"), (process("event-ingest"),), spawner)
    for now_s in (0.0, 1.0):
        supervisor.step(now_s)
    spawner.started[1][1].returncode = -signal.SIGKILL
    now_s = 2.0
    while len(spawner.started) < 3:
        assert supervisor.step(now_s) == []
        now_s += 0.5
        assert now_s < 10.0
    spawner.started[0][1].returncode = 0
    assert supervisor.step(now_s) == ["event-ingest has finished"]
    assert spawner.started[2][1].returncode == 0, "told to end"
    assert supervisor.stop() == []


def test_KILLED_daemon_comes_back_with_growing_pauses() -> None:
    spawner = Spawner()
    supervisor = Supervisor(Path("cell.toml"), (process("segmenter"),), spawner)
    starts_s, now_s = [], 0.0
    while len(starts_s) < 5:
        before = len(spawner.started)
        supervisor.step(now_s)
        if len(spawner.started) > before:
            starts_s.append(now_s)
            spawner.started[-1][1].returncode = -signal.SIGKILL
        now_s += 0.05
    pauses = [b - a for a, b in itertools.pairwise(starts_s)]
    assert pauses == sorted(pauses)
    assert pauses[0] < 0.4
    assert pauses[-1] > 1.0
    assert supervisor.children["segmenter"].restarts == 4


def test_daemon_that_ends_well_stays_ended() -> None:
    spawner = Spawner()
    supervisor = Supervisor(Path("cell.toml"), (process("event-ingest"),), spawner)
    supervisor.step(0.0)
    spawner.started[0][1].returncode = 0
    assert supervisor.step(1.0) == ["event-ingest has finished"]
    supervisor.step(2.0)
    assert len(spawner.started) == 1


def test_exit_is_described_for_people() -> None:
    assert describe_exit(3) == "exit code 3"
    assert describe_exit(-9) == "signal SIGKILL"
