"""A process of its own on the bus, for the tests: ``python worker.py ROLE '{"config": ..., ...}'``.

It prints one JSON line per thing that happens, the first when it is ready; SIGTERM or the end of its input ends it.
"""

from __future__ import annotations

import json
import select
import signal
import sys
import time
from collections.abc import Callable
from typing import Any

import numpy as np

from motiondlo.bus.config import BusConfig
from motiondlo.bus.session import Bus, open_bus
from motiondlo.events.types import EventBatch, empty_events
from motiondlo.messages.correction import CorrectionMessage
from motiondlo.messages.events import EventBatchMessage
from motiondlo.messages.header import Message
from motiondlo.messages.state import StateDlo, StateMessage
from motiondlo.topics import topic
from motiondlo.tracking.types import Correction, CorrectionKind

_ended = False


def _end(*_: object) -> None:
    global _ended
    _ended = True


def ended() -> bool:
    """Whether to stop: SIGTERM, or the test closed our input."""
    return _ended or bool(select.select([sys.stdin], [], [], 0)[0])


def say(**what: Any) -> None:
    """One line to the test."""
    sys.stdout.write(json.dumps(what) + "\n")
    sys.stdout.flush()


def make_state(i: int) -> StateMessage:
    """A straight DLO of 50 nodes that moves right."""
    nodes = np.stack([np.linspace(100, 600, 50) + i * 0.1, np.full(50, 300.0)], axis=1)
    dlo = StateDlo(
        id=1,
        nodes=nodes,
        sigma_px=np.ones(50),
        velocity_px_s=np.tile([100.0, 0.0], (50, 1)),
        visible=np.ones(50, np.uint8),
        diameter_px=12.0,
        length_px=500.0,
        confidence=0.9,
        moving=True,
        source="event",
        t_corrected_us=-1,
    )
    return StateMessage(
        t_us=i * 1000, t_events_us=i * 1000, t_utc_ns=0, t_ingest_ns=time.monotonic_ns(), mode="MOTION", dlos=(dlo,)
    )


def make_batch(i: int, n: int = 19_000) -> EventBatchMessage:
    """A batch of 300 KB whose events tell its number."""
    events = empty_events(n)
    events["t"] = i * 1000 + np.arange(n) * 1000 // n
    events["x"] = i % 1280
    return EventBatchMessage.from_batch(EventBatch(i * 1000, (i + 1) * 1000, events), time.monotonic_ns())


def make_correction(i: int) -> CorrectionMessage:
    """A retirement with a number."""
    none = np.zeros(0)
    return CorrectionMessage.from_correction(Correction(i, 1, i, CorrectionKind.RETIRE, np.zeros((0, 2)), none, none))


MAKERS: dict[str, Callable[[int], Message]] = {
    "state": make_state,
    "events/batch": make_batch,
    "correction": make_correction,
}


def publish(bus: Bus, name: str, hz: float) -> None:
    """Send for ever."""
    publisher = bus.publisher(topic(name))
    bus.announce_alive()
    say(ready=True, shared_memory=bus.shared_memory_report().used)
    next_s = time.monotonic()
    while not ended():
        publisher.put(MAKERS[name](publisher.sent))
        next_s = max(next_s + 1.0 / hz, time.monotonic() - 0.1)
        time.sleep(max(0.0, next_s - time.monotonic()))
    say(sent=publisher.sent)


def receive(bus: Bus, name: str) -> None:
    """Say the number of each message."""
    subscriber = bus.subscriber(topic(name))
    bus.announce_alive()
    say(ready=True)
    while not ended():
        message = subscriber.recv(0.05)
        if message is not None:
            say(seq=message.seq, lost_before=subscriber.lost_before)


def serve(bus: Bus) -> None:
    """Pause on request, never reset."""
    server = bus.serve(("pause", "reset"))
    bus.announce_alive()
    say(ready=True)
    while not ended():
        bus.wait(0.05)
        while (command := server.take()) is not None:
            if command.request.verb == "pause":
                command.answer({"paused": True, **command.request.args})
            else:
                command.refuse("A reset is not possible while a DLO moves.", "Stop the robot first.")


def idle(bus: Bus) -> None:
    """Only be there (a gate passes on what others send)."""
    say(ready=True)
    while not ended():
        time.sleep(0.05)


ROLES: dict[str, Callable[..., None]] = {"publish": publish, "receive": receive, "serve": serve, "idle": idle}

if __name__ == "__main__":
    signal.signal(signal.SIGTERM, _end)
    settings = json.loads(sys.argv[2])
    with open_bus(BusConfig.model_validate(settings.pop("config")), settings.pop("source")) as joined:
        ROLES[sys.argv[1]](joined, **settings)
