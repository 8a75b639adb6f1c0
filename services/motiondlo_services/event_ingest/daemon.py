"""The event ingest's shell: a camera, or a recording at its pace; batches, triggers and the clock's mapping out."""

from __future__ import annotations

import sys
import time
from collections.abc import Iterator
from itertools import islice

from motiondlo.bus.session import Bus
from motiondlo.events.reader import EventFile, open_events
from motiondlo.events.types import EventBatch
from motiondlo.messages.reject import Rejected
from motiondlo.topics import HEALTH, STATE
from motiondlo_services.event_ingest.config import EventIngestConfig
from motiondlo_services.event_ingest.core import EventIngestCore, due_ns
from motiondlo_services.event_ingest.live import compile_kernels, serve_camera
from motiondlo_services.event_ingest.readiness import TrackerReadiness
from motiondlo_services.event_ingest.sending import Sender
from motiondlo_services.runtime.shell import Shell, run_daemon

WAIT_S = 0.05
GRACE_S = 0.2
"""After the tracker has its first DLOs: time for the bus to connect the rest, and to get used to one another."""
FIND_FUSION_S = 1.0
"""After a restart fusion is linked again within this time, if there is one."""
WARM_UP_BATCHES = 20
LATE_NS = 20_000_000
"""When sending is this far behind, what is due is taken in first, so that the core can drop the oldest."""


def serve(shell: Shell, bus: Bus) -> None:
    """Play the recording once, or read the camera until told to stop."""
    # Configuration and source.
    config = shell.section(EventIngestConfig)
    recording = shell.cell.recording()
    if recording is None:
        serve_camera(shell, bus, config, _resume_us)
        return
    events = open_events(recording.events_path, shell.cell.geometry)
    player = _Player(shell, bus, events, config)
    shell.ready()

    # A restarted ingest goes on where the cell is; a first one waits until the tracker knows its DLOs.
    start_us = _resume_us(bus, shell.cell.replay.speed)
    if start_us < 0:
        _wait_for_tracker(shell, bus, player, shell.cell.replay.wait_for_tracker_s)
        player.introduce()
        time.sleep(GRACE_S)
        start_us = 0

    # Loop.
    player.play(events.batches(config.batch_us, start_us))


class _Player:
    """Hands batches to the core when they are due, sends what it gives back."""

    def __init__(self, shell: Shell, bus: Bus, events: EventFile, config: EventIngestConfig) -> None:
        self._shell = shell
        self._core = EventIngestCore(None, config.batch_us, config.max_backlog)
        self._sender = Sender(
            shell, bus, self._core, lambda: {f"damage {kind}": count for kind, count in events.damage.items()}
        )

    def has_readers(self) -> bool:
        """Whether somebody takes the batches."""
        return self._sender.has_readers()

    def play(self, batches: Iterator[EventBatch]) -> None:
        """Until the end, or until told to stop."""
        speed = self._shell.cell.replay.speed
        start: tuple[int, int] | None = None
        for batch in batches:
            if not self._shell.running:
                return
            if start is None:
                start = batch.t0_us, time.monotonic_ns()
            late_ns = time.monotonic_ns() - due_ns(batch.t1_us, *start, speed)
            if late_ns < 0:
                time.sleep(-late_ns * 1e-9)
            self._core.push_batches((batch,), time.monotonic_ns())
            if speed <= 0 or late_ns < LATE_NS:
                self._sender.send()
        # One that took over behind the end has nothing to say, and is not to cover what the first one said.
        if start is not None:
            self._sender.send(now=True)

    def introduce(self) -> None:
        """See :meth:`motiondlo_services.event_ingest.sending.Sender.introduce`."""
        self._sender.introduce()


def load_kernels(shell: Shell) -> None:
    """Decode and cut a little, so that nothing is compiled while events are sent."""
    config = shell.section(EventIngestConfig)
    recording = shell.cell.recording()
    if recording is None:
        compile_kernels(shell.cell.geometry, config.batch_us)
        return
    for _ in islice(open_events(recording.events_path, shell.cell.geometry).batches(config.batch_us), WARM_UP_BATCHES):
        pass


def _resume_us(bus: Bus, speed: float = 1.0) -> int:
    """Event time at which a running cell is, whose events come at ``speed``; -1 when no state was ever published."""
    alive = bus.watch_alive()
    deadline_s = time.monotonic() + FIND_FUSION_S
    while "fusion" not in alive.update() and time.monotonic() < deadline_s:
        bus.wait(deadline_s - time.monotonic(), alive)  # its links come back one after the other
    try:
        state = bus.last_value(STATE, timeout_s=0.3)
    except Rejected:
        return -1
    if state is None or state.t_us < 0:
        return -1
    # From when its newest event came in: a state is sent again while there are no events.
    return state.t_us + round((time.monotonic_ns() - state.t_ingest_ns) * 1e-3 * speed)


def _wait_for_tracker(shell: Shell, bus: Bus, player: _Player, limit_s: float) -> None:
    """Before a recording starts its scene is at rest, so its first shapes can be there at the start."""
    health = bus.subscriber(HEALTH)
    readiness = TrackerReadiness()
    deadline_s = time.monotonic() + limit_s
    while shell.running and time.monotonic() < deadline_s and not (readiness.decided and player.has_readers()):
        bus.wait(WAIT_S, health)
        for message in health.drain():
            readiness.on_health(message)
        shell.tick({"waiting_for": readiness.missing}, {})
    if not readiness.ready:
        shell.problems = (f"started without the first shapes: {readiness.missing}",)


def main() -> int:
    """Entry point of ``motiondlo-event-ingest``."""
    return run_daemon("event-ingest", serve, prepare=load_kernels)


if __name__ == "__main__":
    sys.exit(main())
