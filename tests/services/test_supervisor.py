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


def test_every_daemon_is_started_once() -> None:
    spawner = Spawner()
    supervisor = Supervisor(Path("cell.toml"), PROCESSES, spawner)
    for now_s in (0.0, 1.0, 2.0):
        assert supervisor.step(now_s) == []
    assert sorted(name for name, _ in spawner.started) == sorted(row.name for row in PROCESSES)


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
