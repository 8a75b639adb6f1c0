"""The shell around every daemon's core: arguments, configuration, bus, real-time set-up, health, watchdog, shutdown.

A daemon's ``main`` is ``run_daemon(name, body)``; its ``body(shell, bus)`` builds the core, says ``shell.ready()``, and
loops while ``shell.running``, calling ``shell.tick(...)`` at least a few times a second. What takes long and needs no
bus (loading kernels) goes into ``prepare(shell)``: a process that stands by has it behind it when its turn comes.
"""

from __future__ import annotations

import argparse
import os
import sys
import time
from collections import Counter
from collections.abc import Callable, Mapping
from contextlib import ExitStack, closing
from pathlib import Path
from typing import Literal, TypeVar

from pydantic import BaseModel

from motiondlo import __version__
from motiondlo.bus.config import BusConfig
from motiondlo.bus.session import Bus, open_bus
from motiondlo.config.cell import Cell, load_cell
from motiondlo.config.loader import load_section
from motiondlo.errors import MotionDLOError
from motiondlo.heap import EVENTS_STOCK_BYTES, keep_memory
from motiondlo.messages.health import HealthMessage
from motiondlo.topics import EVENTS_BATCH, HEALTH
from motiondlo_services.processes import Process, process
from motiondlo_services.runtime.bus_section import BusSection
from motiondlo_services.runtime.latency import LatencyWindow
from motiondlo_services.runtime.notify import Notifier
from motiondlo_services.runtime.realtime import (
    lock_memory,
    settle_garbage_collector,
    use_normal_scheduling,
    use_processors,
    use_scheduling,
)
from motiondlo_services.runtime.shutdown import StopFlag, die_with_parent
from motiondlo_services.runtime.standby import Turn

Section = TypeVar("Section", bound=BaseModel)
Lifecycle = Literal["starting", "running", "degraded", "stopping"]

HEALTH_PERIOD_NS = 500_000_000


class Shell:
    """What a daemon knows of itself while it runs."""

    def __init__(self, row: Process, config: Path) -> None:
        self.row = row
        self.cell: Cell = load_cell(config)
        self.config_path = config
        self.latencies: dict[str, LatencyWindow] = {}
        self.counts: Counter[str] = Counter()
        """Whatever the daemon counts; shown in health as it is."""
        self.lifecycle: Lifecycle = "starting"
        self.problems: tuple[str, ...] = ()
        self.scheduling = "other"
        self.t_us = -1
        self._stop = StopFlag().install()
        self._notifier = Notifier()
        self._started_ns = time.monotonic_ns()
        self._next_health_ns = 0
        self._rates_from: tuple[int, Counter[str]] = (self._started_ns, Counter())
        self._bus: Bus | None = None

    @property
    def running(self) -> bool:
        """Until somebody asks the process to stop."""
        return not self._stop

    def section(self, model: type[Section]) -> Section:
        """The daemon's own section of the configuration. Raises ConfigError."""
        return load_section(self.config_path, self.row.section, model)

    def use_bus(self, bus: Bus) -> None:
        """Publish health on ``bus`` from now on."""
        self._bus = bus
        self._health = bus.publisher(HEALTH)

    def ready(self) -> None:
        """The core is warm and the inputs are subscribed to: become real-time, tell the manager and the others."""
        settle_garbage_collector()
        if self.cell.cell.realtime:
            if EVENTS_BATCH.name in (*self.row.reads, *self.row.writes):
                keep_memory(EVENTS_STOCK_BYTES)
            locked = lock_memory()
            self.scheduling = f"{use_scheduling(self.row)}, processor {use_processors(self.row)}"
            self.counts["memory_locked"] = int(locked)
        self.lifecycle = "running"
        if self._bus is not None:
            self._bus.announce_alive()
        self._notifier.send("READY=1")
        self._next_health_ns = 0

    def not_wanted(self) -> None:
        """The configuration has no work for this daemon: tell the manager that all is well before it ends."""
        self._notifier.send("READY=1", f"STATUS=not enabled in {self.config_path}")
        self.close()

    def stand_by(self, turn: Turn) -> bool:
        """Wait, with all in memory, until no other process of this daemon works; False if asked to stop before."""
        settle_garbage_collector()
        ready = "READY=1"

        def say() -> None:
            self._notifier.send(ready, "WATCHDOG=1", "STATUS=standing by")

        if not turn.wait(lambda: self.running, say):
            return False
        self._notifier.send("STATUS=working")
        self._started_ns = time.monotonic_ns()
        self._rates_from = (self._started_ns, Counter())
        return True

    def latency(self, name: str, value_ns: int) -> None:
        """Note a latency for health."""
        window = self.latencies.get(name)
        if window is None:
            window = self.latencies[name] = LatencyWindow()
        window.add(value_ns)

    def take_over(self, totals: Mapping[str, int]) -> None:
        """Show a core's own counts: its totals replace what was shown of them."""
        for name, total in totals.items():
            self.counts[name] = total

    def tick(self, info: Mapping[str, bool | int | float | str], rejects: Mapping[str, int], now: bool = False) -> None:
        """Health and watchdog when they are due, or ``now`` because something has changed."""
        now_ns = time.monotonic_ns()
        if now_ns < self._next_health_ns and not now:
            return
        self._next_health_ns = now_ns + HEALTH_PERIOD_NS
        self._notifier.send("WATCHDOG=1")
        if self._bus is not None:
            self._health.put(self._health_message(self._bus, now_ns, info, rejects))

    def _health_message(
        self, bus: Bus, now_ns: int, info: Mapping[str, bool | int | float | str], rejects: Mapping[str, int]
    ) -> HealthMessage:
        by_reason, by_sender = bus.rejects()
        for reason, count in rejects.items():
            by_reason[reason] = by_reason.get(reason, 0) + count
        inputs = bus.inputs()
        since_ns, before = self._rates_from
        span_s = max((now_ns - since_ns) * 1e-9, 1e-9)
        rates = {name: (count - before[name]) / span_s for name, count in self.counts.items()}
        self._rates_from = (now_ns, Counter(self.counts))
        shared_memory = bus.shared_memory_report()
        exhausted = shared_memory.exhausted
        quantiles = {name: window.take() for name, window in self.latencies.items()}
        return HealthMessage(
            t_us=self.t_us,
            daemon=self.row.name,
            pid=os.getpid(),
            lifecycle=self.lifecycle,
            ready=self.lifecycle == "running",
            uptime_s=(now_ns - self._started_ns) * 1e-9,
            problems=self.problems,
            rates_hz=rates | {name: status.rate_hz for name, status in inputs.items()},
            latencies_ms={name: value for name, value in quantiles.items() if value is not None},
            drops=bus.drops() | ({"shared_memory.exhausted": exhausted} if exhausted else {}),
            rejects=by_reason,
            reject_senders=by_sender,
            queues={name: status.queued for name, status in inputs.items()},
            versions={"motiondlo": __version__},
            info={
                "scheduling": self.scheduling,
                "shared_memory": shared_memory.why or f"in use from {shared_memory.threshold_bytes} bytes on",
                "notifications_lost": self._notifier.lost,
                **dict(self.counts),
                **info,
            },
        )

    def close(self) -> None:
        """Say goodbye to the manager."""
        self.lifecycle = "stopping"
        self._notifier.send("STOPPING=1")
        self._notifier.close()


def mesh_session(shell: Shell, section: BusSection) -> BusConfig:
    """The session of a daemon among its peers."""
    return section.of_daemon(shell.cell.cell.name, shell.row.name)


def run_daemon(
    name: str,
    body: Callable[[Shell, Bus], None],
    session: Callable[[Shell, BusSection], BusConfig | None] = mesh_session,
    prepare: Callable[[Shell], None] | None = None,
) -> int:
    """Run a daemon from the command line until it is told to stop, or its work is done; returns the exit code.

    ``session``: the daemon's session, if it is not one of the mesh; None when the configuration does not want it.
    ``prepare``: what is to be done before the bus is joined, and while another process of this daemon still works.
    """
    row = process(name)
    parser = argparse.ArgumentParser(prog=f"motiondlo-{name}", description=f"MotionDLO daemon: {row.purpose}.")
    parser.add_argument("--config", type=Path, required=True, metavar="FILE", help="the cell's configuration")
    parser.add_argument("--supervised", action="store_true", help="end when the parent process ends")
    parser.add_argument("--debug", action="store_true", help="show the traceback of a failure")
    args = parser.parse_args()
    if args.supervised:
        die_with_parent()
    use_normal_scheduling()
    try:
        shell = Shell(row, args.config)
        section = load_section(args.config, "bus", BusSection)
        section.prepare_socket_folder()
        config = session(shell, section)
        if config is None:
            shell.not_wanted()
            return 0
        if prepare is not None:
            prepare(shell)
        with ExitStack() as stack:
            stack.callback(shell.close)
            if row.standby and not shell.stand_by(stack.enter_context(closing(Turn(config.listen[0])))):
                return 0
            with open_bus(config, name) as bus:
                shell.use_bus(bus)
                try:
                    body(shell, bus)
                finally:
                    use_normal_scheduling()
    except MotionDLOError as error:
        if args.debug:
            raise
        print(f"motiondlo-{name}: {error}", file=sys.stderr, flush=True)  # noqa: T201
        return 1
    return 0
