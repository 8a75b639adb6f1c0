"""The whole cell with real processes: what a subscriber sees, against the offline run and under kills."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

import msgpack
import numpy as np
import pytest
import zenoh

from motiondlo.bundled import bundled_recording
from motiondlo.offline.options import TrackOptions
from motiondlo.offline.run_track import track_recording
from motiondlo.recording.layout import open_recording
from motiondlo_services.cell_config import bus_section
from motiondlo_services.live_run import LiveRun, play
from motiondlo_services.live_tracks import tracks_of
from motiondlo_services.supervisor import Supervisor

pytestmark = pytest.mark.live

MakeCell = Callable[..., Path]

STATE_KEYS = {
    "schema": int,
    "seq": int,
    "cell": str,
    "t_us": int,
    "t_events_us": int,
    "t_sent_ns": int,
    "t_utc_ns": int,
    "t_ingest_ns": int,
    "mode": str,
    "dlos": list,
}
POOL_BYTES = 128 << 20
"""Of each process that sends large messages; what is smaller goes with the next process that uses shared memory."""
DLO_ARRAYS = {"nodes": "<f4", "sigma_px": "<f4", "velocity_px_s": "<f4", "visible": "|u1"}


def independent_subscriber(endpoint: str, seconds: float) -> list[tuple[int, bytes]]:
    """Arrival time (monotonic ns) and payload of every state, received with zenoh alone."""
    config = zenoh.Config()
    config.insert_json5("mode", '"client"')
    config.insert_json5("connect/endpoints", f'["{endpoint}"]')
    config.insert_json5("scouting/multicast/enabled", "false")
    received: list[tuple[int, bytes]] = []
    deadline = time.monotonic() + seconds
    while True:
        try:
            session = zenoh.open(config)
            break
        except zenoh.ZError:
            assert time.monotonic() < deadline, "fusion never listened"
            time.sleep(0.1)
    with session, session.declare_subscriber("motiondlo/test/state", zenoh.handlers.FifoChannel(10_000)) as states:
        while time.monotonic() < deadline:
            sample = states.try_recv()
            if sample is not None:
                received.append((time.monotonic_ns(), sample.payload.to_bytes()))
            elif received and time.monotonic_ns() - received[-1][0] > 1_000_000_000:
                break
            else:
                time.sleep(0.0002)
    return received


def assert_follows_the_contract(state: dict[str, object]) -> None:
    for key, kind in STATE_KEYS.items():
        assert isinstance(state[key], kind), key
    assert state["schema"] == 1
    assert state["cell"] == "test"
    assert state["mode"] in ("BOOT", "STATIC", "MOTION", "DEGRADED")
    dlos = state["dlos"]
    assert isinstance(dlos, list)
    for dlo in dlos:
        arrays = {}
        for key, dtype in DLO_ARRAYS.items():
            assert dlo[key]["dtype"] == dtype, key
            arrays[key] = np.frombuffer(dlo[key]["data"], dtype).reshape(dlo[key]["shape"])
            assert np.isfinite(arrays[key]).all()
        count = len(arrays["nodes"])
        assert arrays["nodes"].shape == arrays["velocity_px_s"].shape == (count, 2)
        assert arrays["sigma_px"].shape == arrays["visible"].shape == (count,)
        steps = np.hypot(*np.diff(arrays["nodes"].astype(float), axis=0).T)
        assert abs(steps.sum() - dlo["length_px"]) < 1.0
        assert steps.max() < 1.2 * steps.min(), "equidistant"
        assert 0.0 <= dlo["confidence"] <= 1.0
        assert dlo["source"] in ("event", "frame", "predicted")
        assert isinstance(dlo["moving"], bool)
        assert isinstance(dlo["id"], int)


def test_an_independent_subscriber_reads_states_at_the_trackers_rate(make_cell: MakeCell) -> None:
    config = make_cell()
    cell = subprocess.Popen(
        [Path(sys.executable).with_name("motiondlo"), "run", "--config", str(config), "--until-finished"]
    )
    try:
        received = independent_subscriber(bus_section(config).all_endpoints()["fusion"], seconds=90.0)
    finally:
        cell.send_signal(signal.SIGINT)
        assert cell.wait(20) == 0
    states = [msgpack.unpackb(payload) for _, payload in received]
    for state in states:
        assert_follows_the_contract(state)
    seqs = np.array([state["seq"] for state in states])
    assert (np.diff(seqs) == 1).all(), "none is missing"
    times_us = np.array([state["t_us"] for state in states])
    assert len(states) > 250, "a batch is 2 ms, the recording 600 ms"
    assert (np.diff(times_us) > 0).all()
    assert times_us[-1] - times_us[0] > 500_000
    assert {state["mode"] for state in states} >= {"STATIC", "MOTION"}
    for (arrived_ns, _), state in zip(received, states, strict=True):
        assert 0 < state["t_ingest_ns"] <= state["t_sent_ns"] <= arrived_ns


def test_live_and_offline_give_the_same_trajectory(make_cell: MakeCell) -> None:
    # What overload drops is tested elsewhere; here nothing is to be dropped or thinned.
    unbounded = {"patience": 1000, "most_waiting": 10_000, "most_events": 1_000_000}
    config = make_cell(event_tracker=unbounded)
    run = play(config, time_limit_s=100.0)
    assert run.dropped_batches == 0, "the machine is too busy to compare anything"
    assert run.merged_batches == 0
    assert run.published_batches > 280
    assert run.tracked_batches == run.published_batches, "every batch that was sent"
    assert len(run.states) == run.published_states == run.tracked_batches, "has come out as a state"
    live = tracks_of(run.states)
    offline = track_recording(open_recording(bundled_recording()), TrackOptions())
    assert live.known_ids() == offline.known_ids() == (0,)
    both, in_live, in_offline = np.intersect1d(live.times_us, offline.times_us, return_indices=True)
    assert len(both) > 280
    distance = np.hypot(*np.moveaxis(live.nodes[in_live] - offline.nodes[in_offline], -1, 0))
    assert distance.max() < 0.2


@pytest.mark.parametrize("victim", ["segmenter", "frame-capture"])
def test_KILLED_in_motion_leaves_the_state_unbroken(make_cell: MakeCell, victim: str) -> None:
    killed: list[int] = []

    def kill_in_motion(supervisor: Supervisor, run: LiveRun) -> None:
        pid = supervisor.children[victim].pid
        if not killed and pid is not None and run.states and run.states[-1].mode == "MOTION":
            os.kill(pid, signal.SIGKILL)
            killed.append(run.states[-1].t_us)

    run = play(make_cell(), time_limit_s=100.0, on_step=kill_in_motion)
    assert killed, "it never moved"
    assert run.restarts[victim] == 1
    assert run.lost_states == 0
    after = [state for state in run.states if state.t_us > killed[0]]
    steps_us = np.diff([state.t_us for state in after])
    assert after[-1].t_us - killed[0] > 200_000
    assert steps_us.max() <= 20_000, "no gap in event time"
    arrivals_ms = np.diff([state.t_sent_ns for state in after]) / 1e6
    assert arrivals_ms.max() < 150.0, "no gap in host time"
    assert all([dlo.id for dlo in state.dlos] == [0] for state in after)


def test_the_states_latency_is_the_same_while_the_segmenter_is_busy(make_cell: MakeCell) -> None:
    config = make_cell(event_tracker={"patience": 4})
    quiet = play(config, time_limit_s=100.0)
    busy = play(config, segmenter_load=True, time_limit_s=100.0)
    frames = busy.health["segmenter"].info["frames"]
    assert isinstance(frames, int)
    assert frames >= 2, "the segmenter had work"
    assert len(busy.states) > 0.8 * len(quiet.states)
    # A shared machine's own noise is of this size; a loop that waited for the segmenter would show hundreds of ms.
    assert np.median(busy.latency_ns) < 2.0 * np.median(quiet.latency_ns) + 2e6


def test_the_pools_of_a_cell_are_gone_when_its_command_has_ended() -> None:
    def pools() -> set[Path]:
        found = set()
        for path in Path("/dev/shm").glob("*.zenoh"):
            with suppress(FileNotFoundError):  # someone else's, gone meanwhile
                if path.stat().st_size >= POOL_BYTES:
                    found.add(path)
        return found

    before = pools()
    command = [Path(sys.executable).with_name("motiondlo"), "bench", "live", bundled_recording(), "--quiet"]
    assert subprocess.run(command, check=False, timeout=100).returncode == 0
    assert not pools() - before
