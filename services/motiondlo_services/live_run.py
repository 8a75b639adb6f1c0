"""Play a recording through all the real daemons and collect what a subscriber sees."""

from __future__ import annotations

import random
import socket
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path

import psutil

from motiondlo.bus.session import Bus, open_bus
from motiondlo.errors import MotionDLOError
from motiondlo.fusion.state import FrameRequest
from motiondlo.messages.health import HealthMessage
from motiondlo.messages.state import StateMessage
from motiondlo.topics import HEALTH
from motiondlo_services.cell_config import bus_section, check_configuration, wanted_processes
from motiondlo_services.fusion.asking import FrameAsker
from motiondlo_services.processes import PROCESSES
from motiondlo_services.state_watch import Seen, StateWatch
from motiondlo_services.supervisor import Supervisor

_AFTER_S = 0.8
"""The run ends so long after the last state since the ingest has finished: a last health message is in by then."""
_WAIT_S = 0.02
_CPU_PERIOD_S = 0.25
_LOAD_PERIOD_S = 0.05
_KERNELS_PORTS = Path("/proc/sys/net/ipv4/ip_local_port_range")
_USUAL_KERNELS_PORT = 32768
_LOWEST_PORT = 12_000


@dataclass
class LiveRun:
    """What was seen from outside while a recording was played."""

    states: list[StateMessage] = field(default_factory=list)
    latency_ns: list[int] = field(default_factory=list)
    """Per state that rests on a new batch: from the newest event's entry into the system to its arrival here."""
    lost_states: int = 0
    health: dict[str, HealthMessage] = field(default_factory=dict)
    """The last health message of each daemon."""
    cpu: dict[str, float] = field(default_factory=dict)
    """Processor seconds per second of play, per daemon."""
    restarts: dict[str, int] = field(default_factory=dict)
    events: list[str] = field(default_factory=list)
    """What the supervisor said."""

    @property
    def published_batches(self) -> int:
        """Batches that the ingest has sent."""
        return self._told("event-ingest", "batches")

    @property
    def tracked_batches(self) -> int:
        """Batches that the tracker made an update of."""
        return self._told("event-tracker", "updates")

    @property
    def published_states(self) -> int:
        """States that fusion has sent."""
        return self._told("fusion", "states")

    @property
    def dropped_batches(self) -> int:
        """Batches that never reached the tracker: dropped by the ingest, or lost on the way."""
        return self._told("event-tracker", "lost_batches")

    @property
    def merged_batches(self) -> int:
        """Batches that shared an update with others because the tracker was behind."""
        return self._told("event-tracker", "merged_batches")

    def _told(self, daemon: str, count: str) -> int:
        """A count in the last health message of a daemon; of its newest process, where it was restarted."""
        health = self.health.get(daemon)
        return 0 if health is None else int(health.info.get(count, 0))


def free_first_port() -> int:
    """A port such that it and the following ones, one per daemon, are free on loopback now.

    Below the ports that the kernel hands out to connections: one of those may be taken before its daemon is up.
    """
    try:
        kernels = int(_KERNELS_PORTS.read_text(encoding="ascii").split()[0])
    except (OSError, ValueError, IndexError):
        kernels = _USUAL_KERNELS_PORT
    last = max(kernels, _LOWEST_PORT + 2 * len(PROCESSES)) - len(PROCESSES)
    for _ in range(100):
        first = random.randrange(_LOWEST_PORT, last)
        if all(_is_free(first + k) for k in range(len(PROCESSES))):
            return first
    raise MotionDLOError("No run of free ports on loopback.", "End programs that listen on many ports.")


def _is_free(port: int) -> bool:
    with socket.socket() as probe:
        try:
            probe.bind(("127.0.0.1", port))
        except OSError:
            return False
    return True


def play(
    config: Path,
    segmenter_load: bool = False,
    time_limit_s: float = 600.0,
    on_step: Callable[[Supervisor, LiveRun], None] | None = None,
) -> LiveRun:
    """Start the cell of ``config``, play its recording to the end, stop the cell.

    The subscriber is a process of its own, under SCHED_FIFO where it may, as a robot's gateway would be.
    segmenter_load: keep the segmenter busy with one frame after the other all the time. on_step is called about 50
    times a second (fault injection). Raises MotionDLOError when it does not end within ``time_limit_s``.
    """
    cell = check_configuration(config)
    section = bus_section(config)
    supervisor = Supervisor(config.resolve(), wanted_processes(config))
    run = LiveRun()
    deadline_s = time.monotonic() + time_limit_s
    client = section.of_client(cell.cell.name)
    with StateWatch(config) as watch, open_bus(client, "live-run-health") as bus:
        health = bus.subscriber(HEALTH)
        load = _SegmenterLoad(bus) if segmenter_load else None
        cpu = _CpuMeter()
        end_s, seen = float("inf"), -1
        try:
            while (now_s := time.monotonic()) < min(end_s, deadline_s):
                for one in watch.take(_WAIT_S):
                    _note(run, one)
                run.events += supervisor.step(now_s)
                if on_step is not None:
                    on_step(supervisor, run)
                for message in health.drain():
                    run.health[message.daemon] = message
                if load is not None and run.states:
                    load.step(now_s)
                cpu.step(run, supervisor, now_s)
                if supervisor.children["event-ingest"].finished and len(run.states) != seen:
                    seen, end_s = len(run.states), now_s + _AFTER_S
        finally:
            run.events += [f"{name} had to be killed" for name in supervisor.stop()]
            if load is not None:
                load.close()
    run.restarts = {name: child.restarts for name, child in supervisor.children.items()}
    if end_s == float("inf"):
        raise MotionDLOError(
            f"The recording did not end within {time_limit_s:.0f} s.", "; ".join(run.events[-3:]) or "See the logs."
        )
    return run


def _note(run: LiveRun, seen: Seen) -> None:
    state = seen.state
    if state.t_ingest_ns and (not run.states or run.states[-1].t_ingest_ns != state.t_ingest_ns):
        run.latency_ns.append(seen.arrived_ns - state.t_ingest_ns)
    run.states.append(state)
    run.lost_states = seen.lost


class _CpuMeter:
    """Processor time per daemon since the first state, so that starting up does not count."""

    def __init__(self) -> None:
        self._start: dict[tuple[str, int], tuple[float, float]] = {}
        self._next_s = 0.0

    def step(self, run: LiveRun, supervisor: Supervisor, now_s: float) -> None:
        """Look, a few times a second."""
        if not run.states or now_s < self._next_s:
            return
        self._next_s = now_s + _CPU_PERIOD_S
        for name, child in supervisor.children.items():
            if child.pid is None:
                continue
            with suppress(psutil.Error):
                times = psutil.Process(child.pid).cpu_times()
                used_s = times.user + times.system
                start_s, start_used_s = self._start.setdefault((name, child.pid), (now_s, used_s))
                if now_s > start_s:
                    run.cpu[name] = (used_s - start_used_s) / (now_s - start_s)


class _SegmenterLoad:
    """Hands the segmenter frame after frame, faster than it can work; fusion ignores what it did not ask for."""

    def __init__(self, bus: Bus) -> None:
        self._asker = FrameAsker(bus)
        self._asked = 0
        self._next_s = 0.0

    def step(self, now_s: float) -> None:
        """Ask when it is time."""
        if now_s < self._next_s or self._asker.busy:
            return
        self._next_s = now_s + _LOAD_PERIOD_S
        self._asker.ask(FrameRequest("load", -1), f"load-{self._asked}")
        self._asked += 1

    def close(self) -> None:
        """Stop asking."""
        self._asker.close()
