"""The latency in every state is true: held against a stopwatch that knows nothing of the daemons."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import msgpack
import numpy as np
import pytest
import zenoh

from motiondlo.bus.session import open_bus
from motiondlo.events.types import EventBatch, empty_events
from motiondlo.messages.events import EventBatchMessage
from motiondlo.topics import EVENTS_BATCH
from motiondlo_services.cell_config import bus_section
from motiondlo_services.processes import process
from motiondlo_services.supervisor import Supervisor

pytestmark = pytest.mark.live

BATCHES = 150
PERIOD_S = 0.01
START_S = 60.0


def test_the_latency_in_every_state_is_that_of_a_stopwatch(make_cell: Callable[..., Path]) -> None:
    """The test is the ingest: it sends batches and notes when; states come back over a plain zenoh session."""
    config = make_cell()
    section = bus_section(config)
    rows = tuple(replace(process(name), standby=False) for name in ("event-tracker", "fusion"))
    supervisor = Supervisor(config, rows)
    started_ns: dict[int, int] = {}
    arrived: list[tuple[int, dict[str, int]]] = []
    plain = zenoh.Config()
    plain.insert_json5("mode", '"peer"')
    plain.insert_json5("connect/endpoints", f'["{section.all_endpoints()["fusion"]}"]')
    plain.insert_json5("scouting/multicast/enabled", "false")
    try:
        with (
            open_bus(section.of_daemon("test", "event-ingest"), "event-ingest") as bus,
            zenoh.open(plain) as session,
            session.declare_subscriber("motiondlo/test/state", zenoh.handlers.FifoChannel(10_000)) as states,
        ):
            batches = bus.publisher(EVENTS_BATCH)
            deadline_s, k = time.monotonic() + START_S, 0
            while len(arrived) < BATCHES and time.monotonic() < deadline_s:
                supervisor.step(time.monotonic())
                k += 1
                started_ns[k * 2000] = time.monotonic_ns()
                batch = EventBatch((k - 1) * 2000, k * 2000, empty_events())
                batches.put(EventBatchMessage.from_batch(batch, started_ns[k * 2000]))
                until_s = time.monotonic() + PERIOD_S
                while time.monotonic() < until_s:
                    if (sample := states.try_recv()) is not None:
                        arrived.append((time.monotonic_ns(), msgpack.unpackb(sample.payload.to_bytes())))
                    else:
                        time.sleep(0.0002)
    finally:
        supervisor.stop()
    assert len(arrived) >= BATCHES
    for at_ns, state in arrived:
        assert state["t_ingest_ns"] == started_ns[state["t_us"]], "the clock was started with this batch"
        assert state["t_ingest_ns"] < state["t_sent_ns"] <= at_ns
    stopwatch_ms = np.array([at_ns - started_ns[state["t_us"]] for at_ns, state in arrived]) * 1e-6
    claimed_ms = np.array([state["t_sent_ns"] - state["t_ingest_ns"] for _, state in arrived]) * 1e-6
    # Between both lies the last hop alone: a fraction of a millisecond, and the pause of this test's loop.
    assert np.median(stopwatch_ms - claimed_ms) < 2.0
