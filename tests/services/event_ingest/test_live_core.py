"""A camera that is opened anew: event time goes on, what is missing counts as lost."""

from __future__ import annotations

from tests.common.events.encoding import make_triggers, random_events
from tests.services.event_ingest.test_core import MS, SENSOR, drain

from motiondlo.events.evt3 import Evt3Decoder
from motiondlo.events.writer import Evt3Encoder
from motiondlo_services.event_ingest.core import EventIngestCore


def send(core: EventIngestCore, host0_ns: int, span_us: int) -> None:
    """A camera's stream from its time 0 on, which arrives from ``host0_ns`` on."""
    encoder = Evt3Encoder(SENSOR)
    for t_us in range(0, span_us, 1000):
        events = random_events(20, mean_step_us=0.0)
        events["t"] = t_us
        core.push(encoder.encode(events, make_triggers([(t_us, 0, 1)])), host0_ns + t_us * 1000)


def test_UNPLUGGED_event_time_goes_on_by_the_hosts_clock() -> None:
    core = EventIngestCore(None, max_backlog=10_000)
    core.attach(Evt3Decoder(SENSOR), 10_000 * MS)
    send(core, 10_000 * MS, 500_000)
    before = drain(core)
    assert before[0].batch.t0_us == 0
    core.attach(Evt3Decoder(SENSOR), 12_000 * MS)
    assert all(item.batch.lost_before == 0 for item in drain(core)), "the rest of the camera that is gone"
    send(core, 12_000 * MS, 500_000)
    after = drain(core)
    assert core.epoch == 1
    assert abs(after[0].batch.t0_us - 2_000_000) <= 2000, "2 s later by the host's clock"
    assert 1490 < after[0].batch.lost_before < 1510
    times = [item.batch.t0_us for item in after]
    assert times == list(range(times[0], times[0] + 1000 * len(times), 1000))
    for item in after:
        assert ((item.batch.events["t"] >= item.batch.t0_us) & (item.batch.events["t"] < item.batch.t1_us)).all()
    triggers = core.take_triggers()["t"]
    assert (triggers[1:] > triggers[:-1]).all()
    assert core.clock.steps == 0


def test_RESTARTED_ingest_goes_on_where_the_cell_is() -> None:
    core = EventIngestCore(None, max_backlog=10_000)
    core.attach(Evt3Decoder(SENSOR), 10_000 * MS, resume_us=7_300_500)
    send(core, 10_000 * MS, 100_000)
    items = drain(core)
    assert items[0].batch.t0_us == 7_301_000
    assert items[0].batch.lost_before == 0
    assert sum(len(item.batch.events) for item in items) > 1500
