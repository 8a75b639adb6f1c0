"""The event ingest's shell: plays a recording's events at their pace; batches, triggers and the clock's mapping out."""

from __future__ import annotations

import sys
import time
from collections.abc import Iterator

from motiondlo.bus.publisher import Publisher
from motiondlo.bus.session import Bus
from motiondlo.errors import ConfigError
from motiondlo.events.clock import ClockEstimator
from motiondlo.events.reader import EventFile, open_events
from motiondlo.events.types import EventBatch
from motiondlo.messages.events import ClockMessage, EventBatchMessage, TriggerMessage
from motiondlo.messages.reject import Rejected
from motiondlo.topics import EVENTS_BATCH, EVENTS_CLOCK, EVENTS_TRIGGER, HEALTH, STATE
from motiondlo_services.event_ingest.config import EventIngestConfig
from motiondlo_services.event_ingest.readiness import TrackerReadiness
from motiondlo_services.runtime.shell import Shell, run_daemon

WAIT_S = 0.05
GRACE_S = 0.2
"""After the tracker has its first DLOs: time for the bus to connect the rest."""
CLOCK_PERIOD_NS = 500_000_000


def serve(shell: Shell, bus: Bus) -> None:
    """Play the recording once."""
    # Configuration and source.
    config = shell.section(EventIngestConfig)
    recording = shell.cell.recording()
    if recording is None:
        raise ConfigError(f"{shell.config_path}: [replay] recording is empty.", "Name the recording to play.")
    events = open_events(recording.events_path, shell.cell.geometry)
    player = _Player(shell, bus, events, shell.cell.replay.speed)
    shell.ready()

    # A restarted ingest goes on where the cell is; a first one waits until the tracker knows its DLOs.
    start_us = _resume_us(bus)
    if start_us < 0:
        _wait_for_tracker(shell, bus, player, shell.cell.replay.wait_for_tracker_s)
        start_us = 0

    # Loop.
    player.play(events.batches(config.batch_us, start_us))


class _Player:
    """Sends batches when they are due and keeps the mapping from event clock to host clock."""

    def __init__(self, shell: Shell, bus: Bus, events: EventFile, speed: float) -> None:
        self._shell, self._events, self._speed = shell, events, speed
        self._batches = bus.publisher(EVENTS_BATCH)
        self._triggers = bus.publisher(EVENTS_TRIGGER)
        self._clocks: Publisher[ClockMessage] = bus.publisher(EVENTS_CLOCK)
        self._clock = ClockEstimator()
        self._next_clock_ns = 0

    def has_readers(self) -> bool:
        """Whether somebody takes the batches."""
        return self._batches.has_readers()

    def play(self, batches: Iterator[EventBatch]) -> None:
        """Until the end, or until told to stop."""
        geometry = self._shell.cell.geometry
        first_us, start_ns = -1, 0
        for batch in batches:
            if not self._shell.running:
                return
            if first_us < 0:
                first_us, start_ns = batch.t0_us, time.monotonic_ns()
            if self._speed > 0:
                _sleep_until(start_ns + int((batch.t1_us - first_us) * 1000 / self._speed))
            now_ns = time.monotonic_ns()
            self._batches.put(EventBatchMessage.from_batch(batch, now_ns, geometry.width_px, geometry.height_px))
            if len(batch.triggers):
                self._triggers.put(
                    TriggerMessage(t_us=int(batch.triggers["t"][-1]), triggers=batch.triggers, t_ingest_ns=now_ns)
                )
            self._clock.update(batch.t1_us, now_ns)
            self._after(batch, now_ns)

    def _after(self, batch: EventBatch, now_ns: int) -> None:
        shell = self._shell
        shell.t_us = batch.t1_us
        shell.counts["batches"] += 1
        shell.counts["events"] += len(batch.events)
        shell.counts["triggers"] += len(batch.triggers)
        if now_ns >= self._next_clock_ns and self._clock.ready:
            self._next_clock_ns = now_ns + CLOCK_PERIOD_NS
            self._clocks.put(
                ClockMessage(
                    t_us=batch.t1_us,
                    anchor_us=batch.t1_us,
                    anchor_host_ns=self._clock.host_ns(batch.t1_us),
                    drift_ppm=self._clock.drift_ppm,
                    sigma_us=self._clock.uncertainty_us,
                )
            )
        shell.tick({f"damage {kind}": count for kind, count in self._events.damage.items()}, {})


def _sleep_until(due_ns: int) -> None:
    left_ns = due_ns - time.monotonic_ns()
    if left_ns > 0:
        time.sleep(left_ns * 1e-9)


def _resume_us(bus: Bus) -> int:
    """Event time at which a running cell is; -1 when no state was ever published."""
    try:
        state = bus.last_value(STATE, timeout_s=0.3)
    except Rejected:
        return -1
    if state is None or state.t_us < 0:
        return -1
    return state.t_us + (time.monotonic_ns() - state.t_sent_ns) // 1000


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
    time.sleep(GRACE_S)


def main() -> int:
    """Entry point of ``motiondlo-event-ingest``."""
    return run_daemon("event-ingest", serve)


if __name__ == "__main__":
    sys.exit(main())
