"""STOPPED: a subscriber or the segmenter does not run for a while (SIGSTOP); the state does not notice."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest
from tests.live.faults.conftest import memory_mib

from motiondlo_services.cell_config import bus_section
from motiondlo_services.live_run import LiveRun, play
from motiondlo_services.supervisor import Supervisor

pytestmark = pytest.mark.live

PLAYED_S = 0.56
GROWTH_MIB = 24.0
"""Of a daemon's own memory while someone is stopped; a queue without bound grew by 2 MB a second at real speed."""
SUBSCRIBER = """
import signal
import sys
from motiondlo.bus.config import BusConfig
from motiondlo.bus.session import open_bus
from motiondlo.topics import EVENTS_BATCH, STATE, TRACK
signal.signal(signal.SIGTERM, lambda *_: sys.exit(0))
with open_bus(BusConfig(cell="test", mode="peer", connect=tuple(sys.argv[1:])), "stuck") as bus:
    inputs = [bus.subscriber(topic) for topic in (EVENTS_BATCH, TRACK, STATE)]
    while True:
        bus.wait(1.0)
        for entry in inputs:
            for message in entry.drain():
                print(message.t_us, flush=True)
"""


class Stopper:
    """Stops one process once the DLO moves, for a while; notes latencies and memory."""

    def __init__(self, seconds: float, pid: Callable[[Supervisor], int | None]) -> None:
        self.from_ns = self.to_ns = 0
        self.before_mib: dict[str, float] = {}
        self.after_mib: dict[str, float] = {}
        self._seconds, self._pid = seconds, pid
        self._stopped: int | None = None

    def __call__(self, supervisor: Supervisor, run: LiveRun) -> None:
        """To be called all the time."""
        now_ns = time.monotonic_ns()
        if not self.from_ns:
            pid = self._pid(supervisor)
            if pid is None or not run.states or run.states[-1].mode != "MOTION":
                return
            self.before_mib = memory_mib(supervisor)
            os.kill(pid, signal.SIGSTOP)
            self._stopped, self.from_ns = pid, now_ns
        elif not self.to_ns and now_ns > self.from_ns + self._seconds * 1e9:
            self.after_mib = memory_mib(supervisor)
            self.go_on()
            self.to_ns = now_ns

    def go_on(self) -> None:
        """However the test ends."""
        if self._stopped is not None:
            os.kill(self._stopped, signal.SIGCONT)
            self._stopped = None


@contextmanager
def subscriber(config: Path) -> Iterator[subprocess.Popen[bytes]]:
    """Another process that reads all that the event path sends."""
    endpoints = bus_section(config).all_endpoints().values()
    process = subprocess.Popen([sys.executable, "-c", SUBSCRIBER, *endpoints], stdout=subprocess.DEVNULL)
    try:
        yield process
    finally:
        # A reader that is killed after its senders would leave their segments to the next program that uses any.
        process.terminate()
        try:
            process.wait(10.0)
        finally:
            process.kill()
            process.wait()


def assert_nothing_was_noticed(run: LiveRun, stopper: Stopper) -> None:
    assert stopper.to_ns, "the motion ended too early"
    assert run.lost_states == 0
    assert run.dropped_batches == 0
    assert set(run.restarts.values()) == {0}
    sent_ns = np.array([state.t_sent_ns for state in run.states])
    latency_ms = (sent_ns - np.array([state.t_ingest_ns for state in run.states])) * 1e-6
    moving = np.array([state.mode == "MOTION" for state in run.states])
    during = (sent_ns > stopper.from_ns) & (sent_ns < stopper.to_ns)
    assert during.sum() > 20
    # The same run is its own measure: whatever else the machine does, it does it all the time.
    assert np.median(latency_ms[during]) < 2.0 * np.median(latency_ms[moving & ~during]) + 3.0
    # One put that waits for a reader takes hundreds of milliseconds; a busy machine's own hiccups are shorter.
    assert np.percentile(latency_ms[during], 90) < 100.0
    grown = {name: after - stopper.before_mib.get(name, after) for name, after in stopper.after_mib.items()}
    assert max(grown.values()) < GROWTH_MIB, grown


def test_SUBSCRIBER_STUCK_delays_nobody(make_cell: Callable[..., Path], stop_s: float) -> None:
    config = make_cell(speed=PLAYED_S / (2.5 * stop_s))
    with subscriber(config) as process:
        stopper = Stopper(stop_s, lambda _: process.pid)
        try:
            run = play(config, time_limit_s=100.0 + 5.0 * stop_s, on_step=stopper)
        finally:
            stopper.go_on()
        assert process.poll() is None, "it has run"
    assert_nothing_was_noticed(run, stopper)


def test_SEGMENTER_STALLED_delays_nobody(make_cell: Callable[..., Path], stop_s: float) -> None:
    stopper = Stopper(stop_s, lambda supervisor: supervisor.children["segmenter"].pid)
    config = make_cell(speed=PLAYED_S / (2.5 * stop_s))
    try:
        run = play(config, segmenter_load=True, time_limit_s=100.0 + 5.0 * stop_s, on_step=stopper)
    finally:
        stopper.go_on()
    assert_nothing_was_noticed(run, stopper)
