"""SOAK: a live cell with simulated cameras for a while; neither memory nor latency may drift."""

from __future__ import annotations

import time
from pathlib import Path

import numpy as np
import pytest
from tests.live.faults.conftest import POOL_MIB, memory_mib, pools

from motiondlo.bundled import bundled_recording
from motiondlo.bus.session import open_bus
from motiondlo.messages.health import HealthMessage
from motiondlo.messages.state import StateMessage
from motiondlo.topics import HEALTH, STATE
from motiondlo_services.cell_config import bus_section, wanted_processes
from motiondlo_services.live_run import free_first_port
from motiondlo_services.runtime.realtime import use_subscriber_scheduling
from motiondlo_services.supervisor import Supervisor

pytestmark = pytest.mark.live

BOOT_S = 90.0
SETTLE_S = 5.0
"""The first rounds fill caches and histories."""
GROWTH_MIB = 16.0
"""Per daemon, however long the soak: one state kept for ever adds 2 MB a second."""
BATCH_US = 4000
LOST_SHARE = 0.001
"""Of the batches: a machine whose owner takes the processor away for 0.2 s in ten minutes loses as many."""


def write_cell(path: Path) -> Path:
    """The scene goes round and round, at a quarter of its speed and rate for the sake of other programs."""
    recording = bundled_recording()
    path.write_text(
        f'[cell]\nname = "test"\n[calibration]\nevent_from_rgb = "{recording}/homography/rgb_to_event_H.npy"\n'
        '[cameras.event]\ndriver = "simulated"\n[cameras.frame]\ndriver = "simulated"\nstall_ms = 2500.0\n'
        f'[cameras.simulated]\nrecording = "{recording}"\nslow_motion = 4.0\n'
        f"[event_ingest]\nbatch_us = {BATCH_US}\n"
        f"[bus]\nfirst_port = {free_first_port()}\nshared_memory_mib = {POOL_MIB}\n",
        encoding="utf-8",
    )
    return path


@pytest.mark.timeout(0)  # it ends by itself
def test_SOAK_leaves_memory_and_latency_where_they_were(tmp_path: Path, soak_s: float) -> None:
    before = pools()
    config = write_cell(tmp_path / "cell.toml")
    supervisor = Supervisor(config, wanted_processes(config))
    sent_s: list[float] = []
    latency_ms: list[float] = []
    first: StateMessage | None = None
    last: StateMessage | None = None
    trackers: list[HealthMessage] = []
    memory: list[tuple[float, dict[str, float]]] = []
    start_s, next_s = float("inf"), 0.0
    deadline_s = time.monotonic() + BOOT_S
    with open_bus(bus_section(config).of_client("test"), "soak") as bus, use_subscriber_scheduling():
        states = bus.subscriber(STATE, queue=10_000)
        reports = bus.subscriber(HEALTH)
        try:
            while (now_s := time.monotonic()) < min(deadline_s, start_s + SETTLE_S + soak_s):
                supervisor.step(now_s)
                bus.wait(0.05, states)
                for state in states.drain():
                    if start_s == float("inf") and state.dlos:
                        start_s, deadline_s = now_s, float("inf")
                    if now_s > start_s + SETTLE_S:
                        first, last = first or state, state
                    sent_s.append(state.t_sent_ns * 1e-9)
                    latency_ms.append((state.t_sent_ns - state.t_ingest_ns) * 1e-6)
                reported = [message for message in reports.drain() if message.daemon == "event-tracker"]
                trackers += reported if now_s > start_s + SETTLE_S else []
                if now_s >= max(start_s + SETTLE_S, next_s):
                    memory.append((now_s, memory_mib(supervisor)))
                    next_s = now_s + max(0.5, soak_s / 200)
        finally:
            supervisor.stop()
    assert start_s < float("inf"), "no DLO within the time for the start"
    assert {name: child.restarts for name, child in supervisor.children.items() if child.restarts} == {}
    assert first is not None
    assert last is not None
    fed = (last.t_us - first.t_us) // BATCH_US
    assert fed > 0.9 * soak_s * 1e6 / BATCH_US, "the camera went on all the time"
    # What fell behind for a moment shares a state with its neighbours; what is gone is counted, and must not be.
    lost, merged = (
        int(trackers[-1].info[name]) - int(trackers[0].info[name]) for name in ("lost_batches", "merged_batches")
    )
    sent = last.seq - first.seq
    assert lost <= LOST_SHARE * fed, (lost, fed)
    assert sent + merged >= (1.0 - LOST_SHARE) * fed, (sent, merged, fed)
    assert sent > 0.9 * fed, "falling behind is the exception"
    parts = np.array_split(np.array(latency_ms)[np.array(sent_s) > start_s + SETTLE_S], 3)
    early, late = (float(np.median(part)) for part in (parts[0], parts[-1]))
    assert late < 1.5 * early + 1.0, (early, late)
    third = max(1, len(memory) // 3)
    for name in memory[0][1]:
        used = [sample[name] for _, sample in memory if name in sample]
        grown = float(np.median(used[-third:])) - float(np.median(used[:third]))
        assert grown < GROWTH_MIB, (name, used[:third], used[-third:])
    assert not pools() - before, "left over in shared memory"
