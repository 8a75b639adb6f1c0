"""Runs a cell's daemons on a desk, as systemd does in production: starts, restarts with back-off, stops cleanly.

Times are passed in, so that the restart policy can be tested without waiting; :func:`supervise` is the shell around it.
"""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from pathlib import Path

from motiondlo_services.processes import Process
from motiondlo_services.runtime.realtime import ONE_THREAD

_STOP_TIMEOUT_S = 5.0
_BACKOFF_FIRST_S = 0.2
_BACKOFF_MAX_S = 5.0
_STEADY_AFTER_S = 10.0
"""A daemon that ran this long starts again with the shortest pause."""
_STANDBY_AFTER_S = 1.0
"""A process that stands by is started so long after the one that works."""


@dataclass
class Child:
    """One daemon under supervision, and how often it had to be started again."""

    row: Process
    popen: subprocess.Popen[bytes] | None = None
    """The process that works."""
    standby: subprocess.Popen[bytes] | None = None
    """The one that takes over when it ends (see :mod:`motiondlo_services.runtime.standby`)."""
    standby_at_s: float = 0.0
    started_s: float = 0.0
    start_at_s: float = 0.0
    failures_in_a_row: int = 0
    restarts: int = 0
    finished: bool = False

    @property
    def pid(self) -> int | None:
        """Process id while it runs."""
        return None if self.popen is None else self.popen.pid


@dataclass
class Supervisor:
    """Keeps every child running until it ends by itself with exit code 0, or :meth:`stop` is called."""

    config: Path
    rows: tuple[Process, ...]
    spawn: Callable[[Process, Path], subprocess.Popen[bytes]] = field(default_factory=lambda: spawn_daemon)
    children: dict[str, Child] = field(init=False)

    def __post_init__(self) -> None:
        self.children = {row.name: Child(row) for row in self.rows}

    def step(self, now_s: float) -> list[str]:
        """Start what is due, notice what has ended. Returns one line per event, for the person who watches."""
        lines = []
        for child in self.children.values():
            if child.finished:
                continue
            if child.popen is None:
                if now_s >= child.start_at_s:
                    child.popen = self.spawn(child.row, self.config)
                    child.started_s, child.standby_at_s = now_s, now_s + _STANDBY_AFTER_S
                continue
            code = child.popen.poll()
            if code is None:
                self._keep_standby(child, now_s)
                continue
            child.popen = None
            if code == 0:
                child.finished = True
                if child.standby is not None:
                    child.standby.terminate()
                lines.append(f"{child.row.name} has finished")
                continue
            if child.standby is not None and child.standby.poll() is None:
                child.popen, child.standby = child.standby, None
                child.started_s, child.standby_at_s = now_s, now_s + _STANDBY_AFTER_S
                child.restarts += 1
                lines.append(f"{child.row.name} ended with {describe_exit(code)}; the one that stood by takes over")
                continue
            if now_s - child.started_s >= _STEADY_AFTER_S:
                child.failures_in_a_row = 0
            pause_s = min(_BACKOFF_FIRST_S * 2**child.failures_in_a_row, _BACKOFF_MAX_S)
            child.failures_in_a_row += 1
            child.restarts += 1
            child.start_at_s = now_s + pause_s
            lines.append(f"{child.row.name} ended with {describe_exit(code)}; starting it again in {pause_s:.1f} s")
        return lines

    def _keep_standby(self, child: Child, now_s: float) -> None:
        if child.standby is not None and child.standby.poll() is not None:
            child.standby, child.standby_at_s = None, now_s + _BACKOFF_MAX_S
        if child.row.standby and child.standby is None and now_s >= child.standby_at_s:
            child.standby = self.spawn(child.row, self.config)

    def stop(self) -> list[str]:
        """SIGTERM to all, SIGKILL to those that do not listen; waits for each. Returns the names that were killed."""
        # Those that stand by first: they must not take over from the ones that end.
        running = [(c, c.standby) for c in self.children.values() if c.standby is not None]
        running += [(c, c.popen) for c in self.children.values() if c.popen is not None]
        for _, popen in running:
            popen.terminate()
        deadline_s = time.monotonic() + _STOP_TIMEOUT_S
        killed = []
        for child, popen in running:
            try:
                popen.wait(max(0.05, deadline_s - time.monotonic()))
            except subprocess.TimeoutExpired:
                popen.kill()
                popen.wait()
                killed.append(child.row.name)
            child.popen = child.standby = None
        return killed


def describe_exit(code: int) -> str:
    """ "exit code 1" or "signal SIGKILL", from what subprocess reports."""
    return f"exit code {code}" if code >= 0 else f"signal {signal.Signals(-code).name}"


def spawn_daemon(row: Process, config: Path) -> subprocess.Popen[bytes]:
    """Start a daemon in its own process group; it dies with the supervisor, however that ends."""
    return subprocess.Popen(
        [sys.executable, "-m", row.module, "--config", str(config), "--supervised"],
        env={**os.environ, **ONE_THREAD},
        stdin=subprocess.DEVNULL,
        process_group=0,
    )


def supervise(
    supervisor: Supervisor,
    stopped: Callable[[], bool],
    say: Callable[[str], None],
    until_finished: Iterable[str] = (),
    period_s: float = 0.05,
) -> None:
    """Run until ``stopped()``, or until the daemons named in ``until_finished`` have ended; then stop the rest."""
    wanted = tuple(until_finished)
    try:
        while not stopped():
            for line in supervisor.step(time.monotonic()):
                say(line)
            if wanted and all(supervisor.children[name].finished for name in wanted):
                break
            time.sleep(period_s)
    finally:
        for name in supervisor.stop():
            say(f"{name} did not stop within {_STOP_TIMEOUT_S:.0f} s and was killed")
