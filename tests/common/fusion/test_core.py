"""Scenarios of the fusion core: boot, rest, late and wrong segmentations, a tracker that was restarted."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import numpy.typing as npt
import pytest

from motiondlo.frames.types import EndKind, Instance, Segmentation
from motiondlo.fusion.core import FusionCore
from motiondlo.fusion.params import FusionParams
from motiondlo.fusion.state import Mode
from motiondlo.tracking.types import CorrectionKind, TrackSource, TrackState, TrackUpdate

FloatArray = npt.NDArray[np.float64]


def line(y: float, x0: float = 100.0, x1: float = 500.0, count: int = 20) -> FloatArray:
    return np.stack([np.linspace(x0, x1, count), np.full(count, y)], axis=1)


def instance(nodes: FloatArray, score: float = 0.9) -> Instance:
    return Instance(
        nodes_rgb=nodes,
        nodes_event=nodes,
        sigma_px=np.full(len(nodes), 1.0),
        width_rgb_px=20.0,
        diameter_px=20.0,
        score=score,
        ends=(EndKind.HELD, EndKind.TIP),
    )


def track(dlo_id: int, nodes: FloatArray, moving: bool = False, confidence: float = 0.9) -> TrackState:
    count = len(nodes)
    return TrackState(
        id=dlo_id,
        nodes=nodes,
        velocity_px_s=np.zeros((count, 2)),
        cov_px2=np.tile([4.0, 0.0, 9.0], (count, 1)),
        visible=np.ones(count, np.uint8),
        diameter_px=20.0,
        confidence=confidence,
        moving=moving,
        source=TrackSource.EVENT,
        t_corrected_us=-1,
    )


def update(t_us: int, *tracks: TrackState) -> TrackUpdate:
    return TrackUpdate(t_us, t_us - 10, tuple(tracks))


def booted(params: FusionParams | None = None, nodes: FloatArray | None = None) -> tuple[FusionCore, FloatArray]:
    """A core that knows one DLO at rest since 1 s; nothing is under way."""
    nodes = line(200.0) if nodes is None else nodes
    core = FusionCore(params or FusionParams())
    assert core.frame_request() is not None
    core.on_segmentation(Segmentation(12_000, "first", (instance(nodes),)), now_us=-1)
    for t_us in range(1000, 1_000_000, 5000):
        core.on_track(update(t_us, track(0, nodes)))
    return core, nodes


def test_boot_asks_for_the_first_frame_and_starts_one_track_per_instance() -> None:
    core = FusionCore(FusionParams())
    request = core.frame_request()
    assert request is not None
    assert request.after_us == -1
    assert core.frame_request() is None, "one request at a time"
    corrections = core.on_segmentation(
        Segmentation(12_000, "first", (instance(line(100.0)), instance(line(300.0)))), now_us=-1
    )
    assert [c.id for c in corrections] == [0, 1]
    assert {c.kind for c in corrections} == {CorrectionKind.REINITIALISE}
    assert [c.not_before_us for c in corrections] == [-1, -1], "the first shapes are taken at once"


def test_boot_asks_again_on_the_hosts_time_until_there_is_event_time() -> None:
    core = FusionCore(FusionParams(retry_first_ms=100.0))
    assert core.frame_request(0) is not None
    core.on_segmentation(Segmentation(-1, "", failure="nobody takes frames"), now_us=-1)
    assert core.frame_request(50_000) is None
    again = core.frame_request(150_000)
    assert again is not None
    assert again.after_us == -1


def test_mode_follows_motion_at_once_and_rest_after_a_while() -> None:
    core, nodes = booted(FusionParams(static_after_ms=100.0))
    assert core.on_track(update(1_001_000, track(0, nodes))).mode == Mode.STATIC
    assert core.on_track(update(1_002_000, track(0, nodes, moving=True))).mode == Mode.MOTION
    assert core.on_track(update(1_100_000, track(0, nodes))).mode == Mode.MOTION
    assert core.on_track(update(1_103_000, track(0, nodes))).mode == Mode.STATIC


def test_coming_to_rest_asks_for_a_frame_taken_since() -> None:
    core, nodes = booted(FusionParams(static_after_ms=100.0, refresh_static_s=100.0))
    core.on_track(update(1_001_000, track(0, nodes, moving=True)))
    assert core.frame_request() is None
    core.on_track(update(1_200_000, track(0, nodes)))
    request = core.frame_request()
    assert request is not None
    assert request.after_us == 1_200_000


def test_late_shape_meets_the_track_of_its_own_time_and_keeps_its_direction() -> None:
    core, _ = booted()
    moved = line(400.0)
    for t_us in range(1_000_000, 2_000_000, 5000):
        core.on_track(update(t_us, track(0, moved, moving=True)))
    seen = line(201.0)[::-1].copy()  # where it was at 0.9 s, found from the other end
    (correction,) = core.on_segmentation(Segmentation(900_000, "late", (instance(seen),)), now_us=1_999_000)
    assert (correction.id, correction.kind, correction.t_us) == (0, CorrectionKind.BLEND, 900_000)
    np.testing.assert_allclose(correction.nodes, line(201.0))
    assert correction.ends == (EndKind.TIP, EndKind.HELD), "the ends turn with the nodes"
    assert correction.not_before_us > 1_995_000


def test_shape_far_from_a_lost_track_starts_it_anew_and_identities_do_not_swap() -> None:
    core = FusionCore(FusionParams())
    core.frame_request()
    core.on_segmentation(Segmentation(0, "first", (instance(line(100.0)), instance(line(200.0)))), now_us=-1)
    core.on_track(update(1000, track(0, line(100.0), confidence=0.1), track(1, line(200.0))))
    corrections = core.on_segmentation(
        Segmentation(1000, "second", (instance(line(200.5)), instance(line(130.0)))), now_us=5000
    )
    assert {(c.id, c.kind) for c in corrections} == {(1, CorrectionKind.BLEND), (0, CorrectionKind.REINITIALISE)}


def contradict(
    core: FusionCore, y: float, t_us: int, nodes: FloatArray, moving: bool = False, confidence: float = 0.9
) -> list[CorrectionKind]:
    core.on_track(update(t_us, track(0, nodes, moving, confidence)))
    seg = Segmentation(t_us, "far", (instance(line(y)),))
    return [c.kind for c in core.on_segmentation(seg, now_us=t_us)]


def test_a_confident_track_outvotes_a_shape_beside_it_and_the_refusal_is_counted() -> None:
    core, nodes = booted()
    assert contradict(core, 240.0, 1_010_000, nodes) == []
    assert core.rejects.as_dict() == {"outvoted": 1}


@pytest.mark.parametrize(("confidence", "votes"), [(0.9, 4), (0.4, 2), (0.1, 1)])
def test_shapes_in_a_row_that_agree_overrule_a_track_at_rest(confidence: float, votes: int) -> None:
    core, nodes = booted()
    kinds = [contradict(core, 240.0 + k, 1_010_000 + 500_000 * k, nodes, confidence=confidence) for k in range(votes)]
    assert kinds == [*([[]] * (votes - 1)), [CorrectionKind.REINITIALISE]]


def test_shapes_of_the_same_moment_are_one_vote_and_another_frame_is_asked_for() -> None:
    core, nodes = booted()
    assert not any(contradict(core, 240.0, 1_010_000 + 10_000 * k, nodes, confidence=0.4) for k in range(20))
    core.on_track(update(1_215_000, track(0, nodes, confidence=0.4)))
    request = core.frame_request()
    assert request is not None
    assert (request.reason, request.ids) == ("contradicted", frozenset({0}))


def test_shapes_that_disagree_with_one_another_overrule_nothing() -> None:
    core, nodes = booted(FusionParams(overrule_votes=3))
    assert not any(contradict(core, 170.0 if k % 2 else 240.0, 1_010_000 + 500_000 * k, nodes) for k in range(6))


def test_motion_that_the_events_support_ends_a_vote() -> None:
    core, nodes = booted(FusionParams(overrule_votes=2))
    assert contradict(core, 240.0, 1_010_000, nodes) == []
    core.on_track(update(1_015_000, track(0, nodes, moving=True)))
    assert contradict(core, 240.0, 1_020_000, nodes) == []


def test_a_shape_of_two_dlos_in_one_line_has_no_tip_where_the_track_has_none() -> None:
    core, nodes = booted()
    core.on_track(update(1_010_000, track(0, nodes)))
    merged = instance(line(200.0, 100.0, 900.0))
    (correction,) = core.on_segmentation(Segmentation(1_010_000, "merged", (merged,)), now_us=1_010_000)
    assert correction.ends == (EndKind.HELD, EndKind.HIDDEN)
    assert correction.appearance is None


def test_a_missing_dlo_segmented_elsewhere_is_not_born_a_second_time() -> None:
    core, nodes = booted()
    for k in range(4):
        t_us = 1_010_000 + 10_000 * k
        core.on_track(update(t_us, track(0, nodes)))
        assert core.on_segmentation(Segmentation(t_us, "x", (instance(line(500.0)),)), now_us=t_us) == ()
    assert core.rejects.as_dict() == {"unconfirmed": 4}


def test_blend_weights_by_confidence_and_age() -> None:
    core, nodes = booted(FusionParams(method="blend", blend_memory_ms=100.0))
    core.on_track(update(1_010_000, track(0, nodes, confidence=0.9)))
    seg = Segmentation(910_000, "late", (instance(line(220.0), score=0.9),))
    (correction,) = core.on_segmentation(seg, now_us=1_010_000)
    assert (correction.kind, correction.t_us) == (CorrectionKind.REINITIALISE, 1_010_000)
    np.testing.assert_allclose(correction.nodes[:, 1], 200.0 + 20.0 * 0.5 * np.exp(-1.0), atol=1e-6)


def test_one_dlo_rests_while_another_moves_and_is_asked_for() -> None:
    core = FusionCore(FusionParams(static_after_ms=100.0))
    core.frame_request()
    core.on_segmentation(Segmentation(0, "first", (instance(line(100.0)), instance(line(300.0)))), now_us=-1)
    core.on_track(update(1000, track(0, line(100.0), moving=True), track(1, line(300.0), moving=True)))
    for t_us in range(2000, 110_000, 1000):
        state = core.on_track(update(t_us, track(0, line(100.0)), track(1, line(300.0), moving=True)))
    assert state.mode == Mode.MOTION
    request = core.frame_request()
    assert request is not None
    assert request.ids == {0}


def test_a_request_is_cancelled_when_its_dlo_moves_again_and_does_not_block_the_next() -> None:
    core, nodes = booted(FusionParams(static_after_ms=100.0, refresh_static_s=100.0))
    core.on_track(update(1_001_000, track(0, nodes, moving=True)))
    core.on_track(update(1_110_000, track(0, nodes)))
    first = core.frame_request()
    assert first is not None
    core.on_track(update(1_120_000, track(0, nodes, moving=True)))
    assert not core.awaits(first)
    assert core.cancelled == 1
    core.on_track(update(1_230_000, track(0, nodes)))
    second = core.frame_request()
    assert second is not None
    late = Segmentation(1_110_000, "late", failure="slow")
    core.on_segmentation(late, now_us=1_240_000, number=first.number)
    assert core.awaits(second), "the answer to the cancelled one is not taken for this one's"


def test_new_dlo_needs_to_be_seen_twice_and_gets_a_new_id() -> None:
    core, nodes = booted()
    both = (instance(nodes), instance(line(600.0)))
    first = core.on_segmentation(Segmentation(900_000, "a", both), now_us=990_000)
    assert [c.id for c in first] == [0]
    second = core.on_segmentation(Segmentation(950_000, "b", both), now_us=995_000)
    assert {(c.id, c.kind) for c in second} == {(0, CorrectionKind.BLEND), (1, CorrectionKind.REINITIALISE)}


def test_failures_back_off_degrade_and_recover() -> None:
    params = FusionParams(degraded_after_failures=2, retry_first_ms=100.0, refresh_static_s=0.1)
    core, nodes = booted(params)
    asked_us = []
    for t_us in range(1_000_000, 3_000_000, 10_000):
        state = core.on_track(update(t_us, track(0, nodes)))
        if core.frame_request() is not None:
            asked_us.append(t_us)
            core.on_segmentation(Segmentation(t_us, "bad", failure="black"), now_us=t_us)
    pauses = np.diff(asked_us)
    assert len(asked_us) >= 4
    assert (pauses[1:] >= 1.5 * pauses[:-1]).all(), "each pause is longer than the one before"
    assert state.mode == Mode.DEGRADED
    core.on_segmentation(Segmentation(2_990_000, "good", (instance(nodes),)), now_us=2_990_000)
    assert core.on_track(update(3_000_000, track(0, nodes))).mode == Mode.STATIC


def test_tracker_restarted_gets_its_dlos_back_under_their_ids() -> None:
    core, nodes = booted()
    core.on_track(update(1_000_000))
    (correction,) = core.corrections_due()
    assert (correction.id, correction.kind) == (0, CorrectionKind.REINITIALISE)
    np.testing.assert_allclose(correction.nodes, nodes)
    core.on_track(update(1_001_000))
    assert core.corrections_due() == (), "given back once"


def test_fusion_restarted_adopts_the_trackers_ids() -> None:
    core = FusionCore(FusionParams(birth_confirmations=1), first_seq=1000)
    core.on_track(update(5_000_000, track(7, line(200.0))))
    corrections = core.on_segmentation(
        Segmentation(5_000_000, "x", (instance(line(201.0)), instance(line(600.0)))), now_us=5_001_000
    )
    assert [c.id for c in corrections] == [7, 8]
    assert all(c.seq > 1000 for c in corrections)


def test_unseen_dlo_of_low_confidence_is_retired_and_does_not_come_back() -> None:
    core, nodes = booted(FusionParams(death_confirmations=2))
    ghost = track(1, line(600.0), confidence=0.05)
    t_us, kinds = 1_010_000, []
    for _ in range(2):
        core.on_track(update(t_us, track(0, nodes), ghost))
        kinds += [c.kind for c in core.on_segmentation(Segmentation(t_us, "x", (instance(nodes),)), now_us=t_us)]
        t_us += 10_000
    assert kinds == [CorrectionKind.BLEND, CorrectionKind.BLEND, CorrectionKind.RETIRE]
    core.on_track(update(t_us, track(0, nodes), ghost))  # was on its way
    core.on_track(update(t_us + 1000, track(0, nodes)))
    assert core.corrections_due() == ()


def test_sigma_in_the_state_is_along_the_normal() -> None:
    core = FusionCore(FusionParams())
    state = core.on_track(update(1000, track(0, line(200.0))))
    np.testing.assert_allclose(state.dlos[0].sigma_px, 3.0)
    assert abs(state.dlos[0].length_px - 400.0) < 1e-9


def test_RESTARTED_tracker_gets_a_moving_dlo_back_with_its_motion_and_the_state_never_lacks_it() -> None:
    core, nodes = booted()
    velocity = np.tile([0.0, 800.0], (len(nodes), 1))
    moving = replace(track(0, nodes, moving=True), velocity_px_s=velocity)
    core.on_track(update(1_000_000, moving))
    assert core.corrections_due() == ()
    state = core.on_track(update(1_050_000))
    assert [dlo.id for dlo in state.dlos] == [0]
    np.testing.assert_allclose(state.dlos[0].nodes, nodes + np.array([0.0, 40.0]))
    assert state.dlos[0].source == TrackSource.PREDICTED
    (given_back,) = core.corrections_due()
    assert given_back.kind is CorrectionKind.REINITIALISE
    assert (given_back.t_us, given_back.not_before_us) == (1_000_000, -1)
    np.testing.assert_array_equal(given_back.nodes, nodes)
    assert given_back.velocity_px_s is not None
    np.testing.assert_array_equal(given_back.velocity_px_s, velocity)
    assert [dlo.id for dlo in core.on_track(update(1_052_000, moving)).dlos] == [0]
    assert core.corrections_due() == ()


def test_OVERLOAD_is_degraded_until_all_events_are_used_again() -> None:
    core, nodes = booted()
    modes = [
        core.on_track(update(t_us, track(0, nodes)), whole=t_us != 1_004_000).mode
        for t_us in range(1_002_000, 1_060_000, 2000)
    ]
    assert modes[0] == Mode.STATIC
    assert modes[1] == modes[10] == Mode.DEGRADED
    assert modes[-1] == Mode.STATIC


def test_FLASH_is_degraded_while_it_lasts() -> None:
    core, nodes = booted()
    flash = replace(update(1_002_000, track(0, nodes)), disturbed="a flash: its events are left out")
    assert core.on_track(flash).mode == Mode.DEGRADED
    assert "flash" in core.degraded_reason
    assert core.on_track(update(1_004_000, track(0, nodes))).mode == Mode.STATIC


def test_CAMERA_GONE_the_last_state_says_that_nothing_supports_it() -> None:
    core, nodes = booted()
    assert FusionCore(FusionParams()).silent(200_000) is None
    before = core.on_track(update(2_000_000, track(0, nodes, moving=True)))
    state = core.silent(2_000_000)
    assert state is not None
    assert (state.t_us, state.t_events_us, state.mode) == (before.t_us, before.t_events_us, Mode.DEGRADED)
    assert "2.0 s" in core.degraded_reason
    (dlo,) = state.dlos
    np.testing.assert_array_equal(dlo.nodes, before.dlos[0].nodes)
    assert dlo.source == "predicted"
    assert not dlo.visible.any()
    assert dlo.confidence < 0.3 * before.dlos[0].confidence
    back = core.on_track(update(4_000_000, track(0, nodes)))
    assert back.mode != Mode.DEGRADED
    assert core.degraded_reason == ""


def test_a_request_that_was_sent_is_withdrawn_when_its_dlo_moves_again() -> None:
    core, nodes = booted()
    core.on_track(update(2_000_000, track(0, nodes, moving=True)))
    core.on_track(update(2_200_000, track(0, nodes)))
    request = core.frame_request()
    assert request is not None
    assert core.withdrawn() == ()
    core.on_track(update(2_300_000, track(0, nodes, moving=True)))
    assert core.withdrawn() == (request.number,)
    assert core.withdrawn() == (), "said once"


def test_a_reset_retires_all_and_begins_with_the_next_frame_under_new_ids() -> None:
    core, nodes = booted()
    core.on_track(update(2_000_000, track(0, nodes)))
    (retired,) = core.reset()
    assert (retired.id, retired.kind) == (0, CorrectionKind.RETIRE)
    core.on_track(update(2_002_000, track(0, nodes)))  # it was on its way
    core.on_track(update(2_004_000))
    request = core.frame_request()
    assert request is not None
    assert request.after_us >= 2_000_000
    (born,) = core.on_segmentation(Segmentation(2_001_000, "next", (instance(nodes),)), 2_100_000, request.number)
    assert (born.id, born.kind) == (1, CorrectionKind.REINITIALISE)
    assert core.corrections_due() == ()


def test_paused_the_events_go_on_alone() -> None:
    core, nodes = booted()
    core.pause(True)
    assert core.on_track(update(5_000_000, track(0, nodes))).mode == Mode.DEGRADED
    assert "paused" in core.degraded_reason
    assert core.frame_request() is None
    assert core.on_segmentation(Segmentation(5_000_000, "x", (instance(line(201.0)),)), now_us=5_000_000) == ()
    core.pause(False)
    assert core.on_track(update(5_002_000, track(0, nodes))).mode == Mode.STATIC
    assert core.frame_request() is not None
