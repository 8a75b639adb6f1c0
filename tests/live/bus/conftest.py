"""Real processes on a bus of free loopback ports; all of them end with the test."""

from __future__ import annotations

import json
import queue
import signal
import socket
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from motiondlo.bus.config import BusConfig

CELL = "testcell"
WORKER = Path(__file__).with_name("worker.py")
DEADLINE_S = 20.0


class Process:
    """A child process and the lines that it prints."""

    def __init__(self, command: list[str]) -> None:
        self.child = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
        self._lines: queue.Queue[str | None] = queue.Queue()
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()

    def _read(self) -> None:
        assert self.child.stdout is not None
        for line in self.child.stdout:
            self._lines.put(line)
        self._lines.put(None)

    def line(self, timeout_s: float = DEADLINE_S) -> str:
        """The next line; fails the test if there is none in time."""
        try:
            line = self._lines.get(timeout=timeout_s)
        except queue.Empty:
            pytest.fail(f"{self.child.args} says nothing for {timeout_s} s")
        if line is None:
            pytest.fail(f"{self.child.args} ended with {self.child.wait()}")
        return line

    def said(self, timeout_s: float = DEADLINE_S) -> dict[str, Any]:
        """The next line, decoded."""
        said: dict[str, Any] = json.loads(self.line(timeout_s))
        return said

    def signal(self, number: signal.Signals) -> None:
        """Send a signal to this process."""
        self.child.send_signal(number)

    def end(self) -> None:
        """Kill it if it still runs, and collect everything."""
        if self.child.poll() is None:
            self.child.send_signal(signal.SIGCONT)
            self.child.kill()
        self.child.wait()
        self._reader.join()
        for stream in (self.child.stdin, self.child.stdout):
            assert stream is not None
            stream.close()


@pytest.fixture
def endpoints() -> dict[str, str]:
    """Free loopback endpoints of a cell of four."""
    names = ("test", "one", "two", "three")
    sockets = [socket.socket() for _ in names]
    for entry in sockets:
        entry.bind(("127.0.0.1", 0))
    found = {name: f"tcp/127.0.0.1:{entry.getsockname()[1]}" for name, entry in zip(names, sockets, strict=True)}
    for entry in sockets:
        entry.close()
    return found


@pytest.fixture
def run() -> Iterator[Callable[[list[str]], Process]]:
    """Starts processes that end with the test."""
    processes: list[Process] = []

    def start(command: list[str]) -> Process:
        processes.append(Process(command))
        return processes[-1]

    yield start
    for process in processes:
        process.end()


@pytest.fixture
def worker(run: Callable[[list[str]], Process], endpoints: dict[str, str]) -> Callable[..., Process]:
    """Starts a worker called ``source`` in ``role`` and waits until it is ready."""

    def start(role: str, source: str, **settings: Any) -> Process:
        config = BusConfig.mesh(CELL, endpoints, source).model_copy(update=settings.pop("bus", {}))
        arguments = {"config": config.model_dump(mode="json"), "source": source, **settings}
        process = run([sys.executable, str(WORKER), role, json.dumps(arguments)])
        assert process.said()["ready"]
        return process

    return start
