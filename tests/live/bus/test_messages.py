"""Messages between real processes: started in any order, killed, stopped, restarted."""

from __future__ import annotations

import itertools
import json
import signal
import time
from collections.abc import Callable
from typing import Any, TypeVar

import msgpack
import numpy as np
import pytest
import zenoh
from tests.live.bus.conftest import CELL, DEADLINE_S, Process
from tests.live.bus.worker import make_correction, make_state

from motiondlo.bus.config import BusConfig
from motiondlo.bus.errors import CommandError
from motiondlo.bus.session import open_bus
from motiondlo.bus.subscriber import Subscriber
from motiondlo.messages.header import Message, Stamp
from motiondlo.rejects import RejectReason
from motiondlo.topics import CORRECTION, EVENTS_BATCH, STATE

pytestmark = pytest.mark.live

M = TypeVar("M", bound=Message)
Worker = Callable[..., Process]


def collect(subscriber: Subscriber[M], enough: Callable[[list[M]], bool]) -> list[M]:
    """Receive until ``enough`` says so; fails if that takes too long."""
    found: list[M] = []
    deadline = time.monotonic() + DEADLINE_S
    while not enough(found):
        message = subscriber.recv(0.2)
        if message is not None:
            found.append(message)
        assert time.monotonic() < deadline, f"only {len(found)} messages"
    return found


def mesh(endpoints: dict[str, str], source: str = "test", **settings: Any) -> BusConfig:
    """This process's place among the peers."""
    return BusConfig.mesh(CELL, endpoints, source, **settings)


@pytest.mark.parametrize("reader_first", [True, False])
def test_states_arrive_whoever_starts_first(worker: Worker, endpoints: dict[str, str], reader_first: bool) -> None:
    # "test" comes first in the mesh, "three" last: the one that connects starts first or second.
    if not reader_first:
        worker("publish", "three", name="state", hz=500)
    with open_bus(mesh(endpoints), "test") as bus:
        subscriber = bus.subscriber(STATE)
        if reader_first:
            worker("publish", "three", name="state", hz=500)
        states = collect(subscriber, lambda found: len(found) >= 200)
        assert all(b.seq > a.seq for a, b in itertools.pairwise(states))
        assert states[-1].dlos[0].nodes.shape == (50, 2)
        status = subscriber.status()
        assert (status.rejected, status.repeated) == (0, 0)


@pytest.mark.parametrize("reader", ["test", "two"])  # the one that is connected to, and the one that connects
def test_a_killed_sender_comes_back_and_is_not_mistaken_for_repeats(
    worker: Worker, endpoints: dict[str, str], reader: str
) -> None:
    with open_bus(mesh(endpoints, reader), reader) as bus:
        subscriber, watch = bus.subscriber(STATE), bus.watch_alive()
        first = worker("publish", "one", name="state", hz=200)
        collect(subscriber, lambda found: len(found) >= 20)
        assert watch.update() == {"one"}
        first.signal(signal.SIGKILL)
        killed = time.monotonic()
        change = watch.take(timeout_s=5.0)
        assert change is not None
        assert not change.alive
        assert time.monotonic() - killed < 1.0
        worker("publish", "one", name="state", hz=200)
        collect(subscriber, lambda found: len(found) >= 20 and found[-1].seq >= 5)
        assert watch.update() == {"one"}
        status = subscriber.status()
        assert (status.restarts, status.repeated, status.rejected) == (1, 0, 0)


def test_a_stopped_daemon_is_missed_within_the_lease(worker: Worker, endpoints: dict[str, str]) -> None:
    with open_bus(mesh(endpoints, lease_ms=400), "test") as bus:
        watch = bus.watch_alive()
        process = worker("publish", "one", name="state", hz=50, bus={"lease_ms": 400})
        change = watch.take(timeout_s=5.0)
        assert change is not None
        assert change.alive
        process.signal(signal.SIGSTOP)
        stopped = time.monotonic()
        change = watch.take(timeout_s=5.0)
        assert change is not None
        assert not change.alive
        assert time.monotonic() - stopped < 1.0
        process.signal(signal.SIGCONT)
        change = watch.take(timeout_s=5.0)
        assert change is not None
        assert change.alive


def test_a_reader_that_is_stopped_holds_nobody_up_and_gets_every_correction(
    worker: Worker, endpoints: dict[str, str]
) -> None:
    with open_bus(mesh(endpoints), "test") as bus:
        corrections, states = bus.publisher(CORRECTION), bus.publisher(STATE)
        stuck = worker("receive", "one", name="correction")
        also_stuck = worker("receive", "two", name="state")
        corrections.put(make_correction(0))
        assert stuck.said() == {"seq": 0, "lost_before": 0}
        for process in (stuck, also_stuck):
            process.signal(signal.SIGSTOP)
        longest_s = 0.0  # behind a stopped reader a sender that blocks is held up for 5 s
        for i in range(1, 1001):
            start = time.monotonic()
            states.put(make_state(i))
            if i % 25 == 0:
                corrections.put(make_correction(i))
            longest_s = max(longest_s, time.monotonic() - start)
            time.sleep(0.001)
        for process in (stuck, also_stuck):
            process.signal(signal.SIGCONT)
        assert [stuck.said() for _ in range(40)] == [{"seq": i, "lost_before": 0} for i in range(1, 41)]
        assert longest_s < 1.0


def test_a_reader_that_joins_late_gets_the_corrections_it_missed(worker: Worker, endpoints: dict[str, str]) -> None:
    with open_bus(mesh(endpoints), "test") as bus:
        corrections = bus.publisher(CORRECTION)
        for i in range(5):
            corrections.put(make_correction(i))
        late = worker("receive", "one", name="correction")
        assert [late.said()["seq"] for _ in range(5)] == [0, 1, 2, 3, 4]
        corrections.put(make_correction(5))
        assert late.said()["seq"] == 5
        late.signal(signal.SIGKILL)
        late.child.wait()
        corrections.put(make_correction(6))
        again = worker("receive", "one", name="correction")
        assert [again.said()["seq"] for _ in range(7)] == [0, 1, 2, 3, 4, 5, 6]


@pytest.mark.parametrize("reader_may_share", [True, False])
def test_large_batches_arrive_whole_also_from_a_sender_that_was_killed(
    worker: Worker, endpoints: dict[str, str], reader_may_share: bool
) -> None:
    with open_bus(mesh(endpoints, shared_memory=reader_may_share), "test") as bus:
        subscriber = bus.subscriber(EVENTS_BATCH)
        first = worker("publish", "one", name="events/batch", hz=200)
        for batch in collect(subscriber, lambda found: len(found) >= 50):
            assert len(batch.events) == 19_000
            assert (batch.events["x"] == batch.seq % 1280).all()
            assert np.array_equal(batch.events["t"][[0, -1]], [batch.t0_us, batch.t1_us - 1])
        first.signal(signal.SIGKILL)
        worker("publish", "one", name="events/batch", hz=200)
        again = collect(subscriber, lambda found: len(found) >= 20 and found[-1].seq >= 10)
        assert (again[-1].events["x"] == again[-1].seq % 1280).all()
        assert subscriber.status().rejected == 0


def test_garbage_is_counted_with_its_reason_and_its_sender(endpoints: dict[str, str]) -> None:
    with open_bus(mesh(endpoints), "test") as bus, zenoh.open(stranger(endpoints["test"])) as session:
        subscriber = bus.subscriber(STATE)
        good = make_state(1).wire_map(Stamp(0, CELL, "fusion", 1)) | {"source": "stranger"}
        bad = {
            RejectReason.NOT_MSGPACK: b"\xc1",
            RejectReason.TOO_LARGE: bytes(STATE.max_payload_bytes + 1),
            RejectReason.FOREIGN_CELL: msgpack.packb(good | {"cell": "other"}),
            RejectReason.SCHEMA_TOO_NEW: msgpack.packb(good | {"schema": 2}),
            RejectReason.FUTURE_TIME: msgpack.packb(good | {"t_sent_ns": time.monotonic_ns() + 10**12}),
        }
        publisher = session.declare_publisher(subscriber.key, congestion_control=zenoh.CongestionControl.BLOCK)
        for payload in (*bad.values(), msgpack.packb(good)):
            publisher.put(payload)
        collect(subscriber, lambda found: len(found) == 1)
        by_reason, by_sender = bus.rejects()
        assert by_reason == {reason.value: 1 for reason in bad}
        assert by_sender["stranger:foreign_cell"] == by_sender["stranger:future_time"] == 1
        assert bus.inputs()["state"].rejected == len(bad)


def stranger(endpoint: str) -> zenoh.Config:
    """A program that is not ours."""
    config = zenoh.Config()
    config.insert_json5("mode", '"client"')
    config.insert_json5("connect/endpoints", json.dumps([endpoint]))
    config.insert_json5("scouting/multicast/enabled", "false")
    return config


def test_commands_are_answered_or_fail_with_a_clear_error(worker: Worker, endpoints: dict[str, str]) -> None:
    with open_bus(mesh(endpoints), "test") as bus:
        process = worker("serve", "one")
        answers = bus.ask("pause", {"why": "test", "limit_px": 2.5}, target="one")
        assert [(answer.daemon, answer.result) for answer in answers] == [
            ("one", {"paused": True, "why": "test", "limit_px": 2.5})
        ]
        with pytest.raises(CommandError, match=r"one refuses reset: .* Stop the robot first."):
            bus.ask("reset")
        with pytest.raises(CommandError, match="Nobody serves get_config"):
            bus.ask("get_config", timeout_s=1.5)
        process.signal(signal.SIGSTOP)
        with pytest.raises(CommandError, match=r"No answer to pause from one within 0\.3 s"):
            bus.ask("pause", target="one", timeout_s=0.3)


def test_sigterm_ends_a_program_with_open_subscriptions_promptly(worker: Worker) -> None:
    process = worker("receive", "one", name="state")
    process.signal(signal.SIGTERM)
    assert process.child.wait(timeout=3.0) == 0
