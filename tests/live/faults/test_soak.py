"""SOAK: a live cell with simulated cameras for a while; neither memory nor latency may drift."""

from __future__ import annotations

import time
from pathlib import Path

import numpy as np
import pytest
from tests.live.faults.conftest import POOL_MIB, memory_mib, pools

from motiondlo.bundled import bundled_recording
from motiondlo.bus.session import open_bus
from motiondlo.topics import STATE
from motiondlo_services.cell_config import bus_section, wanted_processes
from motiondlo_services.live_run import free_first_port
from motiondlo_services.supervisor import Supervisor

pytestmark = pytest.mark.live

BOOT_S = 90.0
SETTLE_S = 5.0
"""The first rounds fill caches and histories."""
GROWTH_MIB = 16.0
"""Per daemon, however long the soak: one state kept for ever adds 2 MB a second."""


def write_cell(path: Path) -> Path:
    """The scene goes round and round, at a quarter of its speed and rate for the sake of other programs."""
    recording = bundled_recording()
    path.write_text(
        f'[cell]\nname = "test"\n[calibration]\nevent_from_rgb = "{recording}/homography/rgb_to_event_H.npy"\n'
        '[cameras.event]\ndriver = "simulated"\n[cameras.frame]\ndriver = "simulated"\nstall_ms = 2500.0\n'
        f'[cameras.simulated]\nrecording = "{recording}"\nslow_motion = 4.0\n'
        "[event_ingest]\nbatch_us = 8000\n"
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
    memory: list[tuple[float, dict[str, float]]] = []
    start_s, next_s = float("inf"), 0.0
    deadline_s = time.monotonic() + BOOT_S
    with open_bus(bus_section(config).of_client("test"), "soak") as bus:
        states = bus.subscriber(STATE, queue=10_000)
        try:
            while (now_s := time.monotonic()) < min(deadline_s, start_s + SETTLE_S + soak_s):
                supervisor.step(now_s)
                bus.wait(0.05, states)
                for state in states.drain():
                    if start_s == float("inf") and state.dlos:
                        start_s, deadline_s = now_s, float("inf")
                    sent_s.append(state.t_sent_ns * 1e-9)
                    latency_ms.append((state.t_sent_ns - state.t_ingest_ns) * 1e-6)
                if now_s >= max(start_s + SETTLE_S, next_s):
                    memory.append((now_s, memory_mib(supervisor)))
                    next_s = now_s + max(0.5, soak_s / 200)
        finally:
            supervisor.stop()
    assert start_s < float("inf"), "no DLO within the time for the start"
    assert {name: child.restarts for name, child in supervisor.children.items() if child.restarts} == {}
    parts = np.array_split(np.array(latency_ms)[np.array(sent_s) > start_s + SETTLE_S], 3)
    # This subscriber has no priority: on a busy machine states pass it by, and it still sees how late they were sent.
    assert len(parts[0]) > 10.0 * soak_s, "125 states a second are sent"
    first, last = (float(np.median(part)) for part in (parts[0], parts[-1]))
    assert last < 1.5 * first + 1.0, (first, last)
    third = max(1, len(memory) // 3)
    for name in memory[0][1]:
        used = [sample[name] for _, sample in memory if name in sample]
        grown = float(np.median(used[-third:])) - float(np.median(used[:third]))
        assert grown < GROWTH_MIB, (name, used[:third], used[-third:])
    assert not pools() - before, "left over in shared memory"
