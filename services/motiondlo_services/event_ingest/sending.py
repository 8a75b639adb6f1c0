"""Sends what the ingest's core gives out: batches, triggers, the clock's mapping, health."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping

from motiondlo.bus.session import Bus
from motiondlo.events.types import EventBatch, empty_events
from motiondlo.messages.events import ClockMessage, EventBatchMessage, TriggerMessage
from motiondlo.topics import EVENTS_BATCH, EVENTS_CLOCK, EVENTS_TRIGGER
from motiondlo_services.event_ingest.core import EventIngestCore
from motiondlo_services.runtime.shell import Shell

CLOCK_PERIOD_NS = 500_000_000


class Sender:
    """The ingest's outputs."""

    def __init__(
        self,
        shell: Shell,
        bus: Bus,
        core: EventIngestCore,
        figures: Callable[[], Mapping[str, bool | int | float | str]],
    ) -> None:
        """figures: what the source says of itself, for health."""
        self._shell, self._core, self._figures = shell, core, figures
        self._batches = bus.publisher(EVENTS_BATCH)
        self._triggers = bus.publisher(EVENTS_TRIGGER)
        self._clocks = bus.publisher(EVENTS_CLOCK)
        self._next_clock_ns = 0
        self.problem = ""
        """What is wrong with the source; the daemon is degraded while there is something."""

    def has_readers(self) -> bool:
        """Whether somebody takes the batches."""
        return self._batches.has_readers()

    def introduce(self) -> None:
        """Send a batch without events that is not to be used, so that no batch with events is late.

        The tracker maps the pool of shared memory with the first message that it gets, for 10 ms and more.
        """
        geometry = self._shell.cell.geometry
        batch = EventBatch(-1, 0, empty_events())
        self._batches.put(EventBatchMessage.from_batch(batch, 0, geometry.width_px, geometry.height_px, valid=False))

    def send(self, now: bool = False) -> None:
        """Send all that waits; health when it is due, or ``now``."""
        geometry = self._shell.cell.geometry
        while (item := self._core.pop()) is not None:
            self._batches.put(
                EventBatchMessage.from_batch(item.batch, item.t_ingest_ns, geometry.width_px, geometry.height_px)
            )
        triggers = self._core.take_triggers()
        if len(triggers):
            self._triggers.put(
                TriggerMessage(t_us=int(triggers["t"][-1]), triggers=triggers, t_ingest_ns=time.monotonic_ns())
            )
        shell = self._shell
        shell.t_us = self._core.t_us
        shell.take_over({"batches": self._core.batches, "events": self._core.events, "lost": self._core.lost})
        self._send_clock()
        shell.lifecycle = "degraded" if self._core.overloaded or self.problem else "running"
        shell.tick({"triggers": self._core.trigger_monitor.triggers, **self._figures()}, self._core.rejects, now=now)

    def _send_clock(self) -> None:
        clock, now_ns = self._core.clock, time.monotonic_ns()
        if now_ns < self._next_clock_ns or not clock.ready:
            return
        self._next_clock_ns = now_ns + CLOCK_PERIOD_NS
        t_us = self._core.t_us
        self._clocks.put(
            ClockMessage(
                t_us=t_us,
                anchor_us=t_us,
                anchor_host_ns=clock.host_ns(t_us),
                drift_ppm=clock.drift_ppm,
                sigma_us=clock.uncertainty_us,
                epoch=self._core.epoch,
                steps=clock.steps,
            )
        )
