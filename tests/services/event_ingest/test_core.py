"""The ingest's core: batches out of bytes, backlog, triggers, pacing, health."""

from __future__ import annotations

import numpy as np
import pytest
from tests.common.events.encoding import make_triggers, random_events

from motiondlo.events.evt3 import Evt3Decoder
from motiondlo.events.joining import join
from motiondlo.events.types import EventBatch, SensorGeometry
from motiondlo.events.writer import Evt3Encoder
from motiondlo_services.event_ingest.core import EventIngestCore, IngestedBatch, due_ns

SENSOR = SensorGeometry()
MS = 1_000_000


def batch(i: int, events: int = 10, lost_before: int = 0, triggers: int = 0) -> EventBatch:
    data = random_events(events, mean_step_us=0.0)
    data["t"] = i * 1000
    return EventBatch(i * 1000, (i + 1) * 1000, data, make_triggers([(i * 1000, 0, 1)] * triggers), lost_before)


def drain(core: EventIngestCore) -> list[IngestedBatch]:
    items = []
    while (item := core.pop()) is not None:
        items.append(item)
    return items


def test_LIVE_bytes_become_batches_with_the_time_at_which_they_came_in() -> None:
    events = random_events(4000, mean_step_us=5.0)
    data = Evt3Encoder(SENSOR).encode(events, make_triggers([(7000, 0, 1), (12_000, 0, 0)]))
    core = EventIngestCore(Evt3Decoder(SENSOR))
    items = []
    for i in range(0, len(data), 999):
        core.push(data[i : i + 999], host_ns=i)
        items += drain(core)
    core.finish(host_ns=len(data))
    items += drain(core)
    np.testing.assert_array_equal(join([item.batch.events for item in items]), events)
    assert [item.batch.t0_us for item in items] == [i * 1000 for i in range(len(items))]
    arrivals = [item.t_ingest_ns for item in items]
    assert arrivals == sorted(arrivals)
    assert core.take_triggers()["t"].tolist() == [7000, 12_000]
    assert core.rejects == {}
    assert core.clock.ready


def test_DAMAGED_bytes_show_in_health() -> None:
    data = bytearray(Evt3Encoder(SENSOR).encode(random_events(4000, mean_step_us=5.0)))
    data[5000:5002] = b"\x00\x90"
    core = EventIngestCore(Evt3Decoder(SENSOR))
    core.push(bytes(data), 0)
    core.finish(1)
    assert core.health()["damage"]["reserved_word"] == 1  # type: ignore[index]
    assert core.events > 3900


def test_BURST_beyond_capacity_drops_the_oldest_and_tells_the_next_batch() -> None:
    core = EventIngestCore(None, max_backlog=5)
    core.push_batches([batch(i) for i in range(12)], host_ns=0)
    items = drain(core)
    assert [item.batch.t0_us for item in items] == [i * 1000 for i in range(7, 12)]
    assert [item.batch.lost_before for item in items] == [7, 0, 0, 0, 0]
    assert core.rejects == {"batch_dropped": 7}
    assert core.overloaded


def test_what_was_lost_before_a_dropped_batch_is_not_forgotten() -> None:
    core = EventIngestCore(None, max_backlog=1)
    core.push_batches([batch(0), batch(4, lost_before=3), batch(5)], host_ns=0)
    (item,) = drain(core)
    assert item.batch.lost_before == 5
    assert core.lost == 5


def test_recovery_within_100_ms_of_the_end_of_a_burst() -> None:
    core = EventIngestCore(None, max_backlog=3)
    core.push_batches([batch(i) for i in range(10)], host_ns=0)
    assert core.overloaded
    for i in range(10, 110):
        drain(core)
        core.push_batches([batch(i)], host_ns=0)
    assert not core.overloaded


def test_a_few_huge_batches_are_bounded_by_their_events(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("motiondlo_services.event_ingest.core.MAX_BACKLOG_EVENTS", 1000)
    core = EventIngestCore(None, max_backlog=50)
    core.push_batches([batch(i, events=400) for i in range(5)], host_ns=0)
    assert core.backlog == 2
    core.push_batches([batch(5, events=5000)], host_ns=0)
    assert [item.batch.t0_us for item in drain(core)] == [5000]


def test_triggers_survive_overload() -> None:
    core = EventIngestCore(None, max_backlog=1)
    core.push_batches([batch(i, triggers=1) for i in range(4)], host_ns=0)
    assert core.take_triggers()["t"].tolist() == [0, 1000, 2000, 3000]
    assert len(core.take_triggers()) == 0
    assert core.health()["triggers"] == 4


def test_event_rate_is_that_of_the_last_second_of_event_time() -> None:
    core = EventIngestCore(None)
    core.push_batches([batch(i, events=10) for i in range(1500)], host_ns=0)
    assert core.health()["events_per_s"] == 10_000
    core.push_batches([batch(1500 + i, events=0) for i in range(500)], host_ns=0)
    assert core.health()["events_per_s"] == 5000


def test_CLOCK_STEP_shows_in_health() -> None:
    core = EventIngestCore(None)
    for i in range(2000):
        jump_ns = 0 if i < 1000 else -300 * MS
        core.push_batches([batch(i, events=0)], host_ns=50_000 * MS + (i + 1) * MS + jump_ns)
    assert core.health()["clock"]["steps"] == 1  # type: ignore[index]


@pytest.mark.parametrize(
    ("speed", "expected_ns"), [(1.0, 1100 * MS), (2.0, 1050 * MS), (0.5, 1200 * MS), (0.0, 1000 * MS)]
)
def test_replay_is_paced_by_event_time(speed: float, expected_ns: int) -> None:
    assert due_ns(150_000, start_us=50_000, start_ns=1000 * MS, speed=speed) == expected_ns


def test_without_a_decoder_there_are_no_bytes() -> None:
    with pytest.raises(RuntimeError, match="decoder"):
        EventIngestCore(None).push(b"", 0)
