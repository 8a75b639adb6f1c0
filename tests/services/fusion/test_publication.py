"""The state message carries the fused state; segmentations are held until their time."""

from __future__ import annotations

import numpy as np

from motiondlo.frames.types import Segmentation
from motiondlo.fusion.state import FusedDlo, FusedState, Mode
from motiondlo.geometry.work_plane import plane_of_scale
from motiondlo.messages.header import Stamp
from motiondlo.messages.reject import Expectation
from motiondlo.messages.state import StateMessage
from motiondlo_services.fusion.publication import Asked, SegmentationHold, Silence, state_message


def fused() -> FusedState:
    nodes = np.stack([np.linspace(0.0, 90.0, 10), np.full(10, 7.0)], axis=1)
    dlo = FusedDlo(
        id=3,
        nodes=nodes,
        sigma_px=np.full(10, 0.5),
        velocity_px_s=np.full((10, 2), 100.0),
        visible=np.ones(10, np.uint8),
        diameter_px=30.0,
        length_px=90.0,
        confidence=0.8,
        moving=True,
        source="event",
        t_corrected_us=12_000,
    )
    return FusedState(t_us=500_000, t_events_us=499_990, mode=Mode.MOTION, dlos=(dlo,))


def test_a_state_passes_the_readers_validation_unchanged() -> None:
    message = state_message(fused(), t_ingest_ns=77, work_plane=plane_of_scale(5.0))
    payload = message.to_bytes(Stamp(9, "cell1", "fusion", 100))
    read = StateMessage.from_bytes(payload, Expectation("cell1"))
    assert (read.seq, read.t_us, read.t_events_us, read.t_ingest_ns, read.mode) == (9, 500_000, 499_990, 77, "MOTION")
    (dlo,) = read.dlos
    assert (dlo.id, dlo.source, dlo.t_corrected_us, dlo.moving) == (3, "event", 12_000, True)
    np.testing.assert_allclose(dlo.nodes, fused().dlos[0].nodes)
    assert dlo.nodes_mm is not None
    np.testing.assert_allclose(dlo.nodes_mm * 5.0, dlo.nodes, rtol=1e-6)


def test_without_a_scale_there_are_no_millimetres() -> None:
    assert state_message(fused(), 0, None).dlos[0].nodes_mm is None


def test_a_replay_holds_a_segmentation_until_its_latency_is_over() -> None:
    hold = SegmentationHold(latency_us=1_000_000)
    hold.put(Segmentation(12_000, "first"), Asked(1, -1))
    assert [(s.frame_name, n) for s, n in hold.due(-1)] == [("first", 1)], "the scene was at rest before the start"
    hold.put(Segmentation(512_000, "later"), Asked(2, 500_000))
    assert hold.due(1_511_999) == []
    assert [(s.frame_name, n) for s, n in hold.due(1_512_000)] == [("later", 2)]
    assert hold.due(9_000_000) == []


def test_a_live_cell_holds_nothing() -> None:
    hold = SegmentationHold(latency_us=0)
    hold.put(Segmentation(512_000, "now"), Asked(1, 500_000))
    assert len(hold.due(500_000)) == 1


MS = 1_000_000


def test_CAMERA_GONE_the_last_state_is_due_soon_and_then_at_the_rate_of_health() -> None:
    silence = Silence(live=True, after_ns=200 * MS, every_ns=500 * MS)
    assert silence.due_us(5000 * MS) == 0, "nothing has ever come"
    silence.broken(6000 * MS)
    due = {t: silence.due_us(t * MS) for t in range(6000, 7500, 10)}
    assert {t: us for t, us in due.items() if us} == {6200: 200_000, 6700: 700_000, 7200: 1_200_000}
    silence.broken(7500 * MS)
    assert silence.due_us(7600 * MS) == 0


def test_a_replay_may_end_or_be_slow() -> None:
    silence = Silence(live=False)
    silence.broken(1)
    assert silence.due_us(10**12) == 0
