"""A small cell in this process, and the real gate in a process of its own, on free loopback ports."""

from __future__ import annotations

import subprocess
import sys
import threading
import time
from collections import Counter
from collections.abc import Callable, Iterator
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from motiondlo.bus.config import BusConfig
from motiondlo.bus.session import Bus, open_bus
from motiondlo.messages.health import HealthMessage
from motiondlo.messages.state import StateDlo, StateMessage
from motiondlo.security.certificates import init, issue_holder
from motiondlo.security.folder import CertificateFolder
from motiondlo.security.tls import remote_client
from motiondlo.topics import STATE
from motiondlo_services.live_run import free_first_port
from motiondlo_services.runtime.bus_section import BusSection

CELL = "guarded"
PERIOD_S = 0.01


def a_state(i: int) -> StateMessage:
    """A DLO of two nodes."""
    dlo = StateDlo(
        id=1,
        nodes=np.array([[0.0, 0.0], [100.0, 0.0]]),
        sigma_px=np.ones(2),
        velocity_px_s=np.zeros((2, 2)),
        visible=np.ones(2, np.uint8),
        diameter_px=10.0,
        length_px=100.0,
        confidence=0.9,
        moving=True,
        source="event",
        t_corrected_us=-1,
    )
    return StateMessage(t_us=i, t_events_us=i, t_utc_ns=0, t_ingest_ns=time.monotonic_ns(), mode="MOTION", dlos=(dlo,))


def a_health() -> HealthMessage:
    """A daemon that is well."""
    return HealthMessage(
        t_us=0,
        daemon="fusion",
        lifecycle="running",
        ready=True,
        uptime_s=1.0,
        problems=(),
        rates_hz={},
        latencies_ms={},
        drops={},
        rejects={},
        reject_senders={},
        queues={},
        versions={},
        info={},
    )


class SmallCell:
    """Fusion publishes its state 100 times a second and serves commands; the tracker hears whatever is sent."""

    def __init__(self, section: BusSection) -> None:
        self.section = section
        self.commands: Counter[str] = Counter()
        self.heard: Counter[str] = Counter()
        """Messages by key below the cell, as the tracker receives them from any session."""
        self.state_gaps_s: list[float] = []
        self.lost_states = 0
        self._end = threading.Event()
        self._ready = threading.Barrier(3)
        self._threads = [
            threading.Thread(target=self._run, args=("event-tracker", self._tracker)),
            threading.Thread(target=self._run, args=("fusion", self._fusion)),
        ]
        for thread in self._threads:
            thread.start()
        self._ready.wait(20.0)

    def _run(self, daemon: str, body: Callable[[Bus], None]) -> None:
        config = self.section.of_daemon(CELL, daemon).model_copy(update={"shared_memory": False})
        with open_bus(config, daemon) as bus:
            body(bus)

    def _fusion(self, bus: Bus) -> None:
        from motiondlo.topics import CORRECTION, HEALTH

        states, health, server = (
            bus.publisher(STATE),
            bus.publisher(HEALTH),
            bus.serve(("pause", "reset", "get_config")),
        )
        corrections = bus.publisher(CORRECTION)
        bus.announce_alive()
        self._ready.wait(20.0)
        assert corrections.sent == 0
        while not self._end.wait(PERIOD_S):
            states.put(a_state(states.sent))
            if states.sent % 10 == 0:
                health.put(a_health())
            while (command := server.take()) is not None:
                self.commands[command.request.verb] += 1
                command.answer({"done": True})

    def _tracker(self, bus: Bus) -> None:
        tap, states = bus.tap(), bus.subscriber(STATE)
        self._ready.wait(20.0)
        last_s = 0.0
        while not self._end.is_set():
            bus.wait(0.05)
            for _ in states.drain():
                now_s = time.monotonic()
                self.state_gaps_s += [now_s - last_s] if last_s else []
                last_s = now_s
            while (item := tap.recv()) is not None:
                self.heard[item[0].removeprefix(f"motiondlo/{CELL}/")] += 1
            self.lost_states = states.status().lost

    def close(self) -> None:
        """End both."""
        self._end.set()
        for thread in self._threads:
            thread.join(10.0)


class Gate:
    """The gate's process."""

    def __init__(self, config: Path, endpoint: str, folder: CertificateFolder) -> None:
        self.endpoint, self.folder, self._config = endpoint, folder, config
        self.start()

    def start(self) -> None:
        """Start it, again if need be."""
        self.child = subprocess.Popen(
            [sys.executable, "-m", "motiondlo_services.gate.daemon", "--config", str(self._config)]
        )

    def visitor(self, name: str, **settings: Any) -> BusConfig:
        """The session of the holder ``name`` from outside."""
        return remote_client(CELL, self.endpoint, self.folder, name, **settings)

    def kill(self) -> None:
        """As a crash would."""
        self.child.kill()
        self.child.wait()


@pytest.fixture(params=["ports", "sockets"])
def section(request: pytest.FixtureRequest, tmp_path: Path) -> BusSection:
    """The cell's own bus, both ways."""
    folder = str(tmp_path / "run") if request.param == "sockets" else ""
    section = BusSection(first_port=free_first_port(), socket_folder=folder, lease_ms=800)
    section.prepare_socket_folder()
    return section


@pytest.fixture
def cell(section: BusSection) -> Iterator[SmallCell]:
    """The small cell, running."""
    running = SmallCell(section)
    yield running
    running.close()


@pytest.fixture
def folder(tmp_path: Path) -> CertificateFolder:
    """The cell's certificates, an expired one among them, and a foreign authority beside them."""
    now = datetime.now(UTC)
    made = CertificateFolder(tmp_path / "certs")
    init(made, CELL, now - timedelta(days=500))
    issue_holder(made, "daemon", "", now, hosts=("localhost", "127.0.0.1"))
    for role, name in (("monitor", ""), ("gateway", ""), ("monitor", "unlisted")):
        issue_holder(made, role, name, now)
    issue_holder(made, "monitor", "old", now - timedelta(days=400))
    other = CertificateFolder(tmp_path / "foreign")
    init(other, CELL, now)
    issue_holder(other, "monitor", "", now)
    return made


@pytest.fixture
def gate(cell: SmallCell, folder: CertificateFolder, tmp_path: Path) -> Iterator[Gate]:
    """The gate of the small cell, reachable."""
    section = cell.section
    endpoint = f"tls/127.0.0.1:{free_first_port()}"
    config = tmp_path / "cell.toml"
    config.write_text(
        f'[cell]\nname = "{CELL}"\nrealtime = false\n'
        f'[bus]\nfirst_port = {section.first_port}\nsocket_folder = "{section.socket_folder}"\n'
        f'[gate]\nenabled = true\nlisten = "{endpoint}"\nvisitors = ["monitor", "monitor.old", "gateway"]\n'
        'gateway_commands = ["pause", "reset"]\n'
    )
    gate = Gate(config, endpoint, folder)
    try:
        with open_bus(gate.visitor("monitor", open_timeout_s=30.0), "waits") as bus:
            assert bus.subscriber(STATE).recv(20.0) is not None
        yield gate
    finally:
        gate.kill()
