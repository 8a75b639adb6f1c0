"""The late-correction rule: refusals with their reasons, waiting, and the history of states."""

from __future__ import annotations

import numpy as np
import pytest

from motiondlo.rejects import RejectReason
from motiondlo.tracking.correction_gate import CorrectionGate, StateHistory
from motiondlo.tracking.types import Correction, CorrectionKind

SECOND = 1_000_000


def correction(
    seq: int,
    t_us: int,
    dlo_id: int = 0,
    kind: CorrectionKind = CorrectionKind.BLEND,
    not_before_us: int = -1,
    nodes: np.ndarray | None = None,
) -> Correction:
    if nodes is None:
        nodes = np.stack([np.arange(5.0), np.zeros(5)], axis=1)
    ones = np.ones(len(nodes))
    return Correction(seq, dlo_id, t_us, kind, nodes, ones, ones, 10.0, not_before_us=not_before_us)


@pytest.fixture
def gate() -> CorrectionGate[str]:
    """DLO 0 started at 1 s and has states until 5 s."""
    gate: CorrectionGate[str] = CorrectionGate(3 * SECOND)
    gate.started(0, SECOND)
    for t_us in range(SECOND, 5 * SECOND + 1, SECOND // 2):
        gate.history(0).record(t_us, f"at {t_us}")
    return gate


@pytest.mark.parametrize(
    ("late", "reason"),
    [
        (correction(0, 4 * SECOND), None),
        (correction(0, 1_500_000), RejectReason.TOO_OLD),
        (correction(0, 500_000), RejectReason.SUPERSEDED),
        (correction(0, 7 * SECOND), RejectReason.FUTURE_TIME),
        (correction(0, 4 * SECOND, dlo_id=9), RejectReason.UNKNOWN_ID),
        (correction(0, 4 * SECOND, dlo_id=9, kind=CorrectionKind.RETIRE), RejectReason.UNKNOWN_ID),
        (correction(0, 4 * SECOND, dlo_id=9, kind=CorrectionKind.REINITIALISE), None),
        (correction(0, 4 * SECOND, nodes=np.full((5, 2), np.nan)), RejectReason.NOT_FINITE),
        (correction(0, 4 * SECOND, nodes=np.zeros((5, 3))), RejectReason.WRONG_SHAPE),
        (correction(0, 4 * SECOND, nodes=np.zeros((1, 2))), RejectReason.WRONG_SHAPE),
        (correction(0, 4 * SECOND, nodes=np.ones((5, 2))), RejectReason.IMPLAUSIBLE),
    ],
)
def test_each_refusal_has_its_reason(gate: CorrectionGate[str], late: Correction, reason: RejectReason | None) -> None:
    assert gate.check(late, 5 * SECOND) is reason
    assert gate.admit(late, 5 * SECOND) is reason
    assert gate.rejects.as_dict() == ({} if reason is None else {reason.value: 1})


def test_repeated_and_reordered_sequence_numbers(gate: CorrectionGate[str]) -> None:
    assert gate.admit(correction(7, 3 * SECOND), 5 * SECOND) is None
    assert gate.admit(correction(7, 3 * SECOND), 5 * SECOND) is RejectReason.REPEATED
    assert gate.admit(correction(6, 3 * SECOND), 5 * SECOND) is RejectReason.OUT_OF_ORDER
    assert gate.admit(correction(8, 4 * SECOND), 5 * SECOND) is None


def test_fusion_restarted_counts_from_zero_again(gate: CorrectionGate[str]) -> None:
    assert gate.admit(correction(700, 3 * SECOND), 5 * SECOND) is None
    assert gate.admit(correction(0, 4 * SECOND), 5 * SECOND) is None
    assert gate.admit(correction(1, 4_500_000), 5 * SECOND) is None
    assert gate.admit(correction(0, 4 * SECOND), 5 * SECOND) is RejectReason.REPEATED


def test_older_frame_after_a_newer_one_was_absorbed_is_out_of_order(gate: CorrectionGate[str]) -> None:
    newer = correction(0, 4 * SECOND)
    assert gate.admit(newer, 5 * SECOND) is None
    gate.absorbed(newer)
    assert gate.admit(correction(1, 3 * SECOND), 5 * SECOND) is RejectReason.OUT_OF_ORDER


def test_correction_waits_for_its_time_and_is_judged_again(gate: CorrectionGate[str]) -> None:
    early = correction(0, 4 * SECOND, not_before_us=6 * SECOND)
    assert gate.admit(early, 5 * SECOND) is None
    assert gate.due(5_999_999) == []
    assert gate.waiting == 1
    gate.started(0, 5_500_000)  # re-initialised while it waited
    assert gate.due(6 * SECOND) == [early]
    assert not gate.still_valid(early, 6 * SECOND)
    assert gate.rejects.as_dict() == {RejectReason.SUPERSEDED.value: 1}


def test_frame_ahead_of_the_clock_may_wait_for_it() -> None:
    gate: CorrectionGate[str] = CorrectionGate()
    ahead = correction(0, 2 * SECOND, kind=CorrectionKind.REINITIALISE, not_before_us=3 * SECOND)
    assert gate.admit(ahead, 0) is None
    follow_up = correction(1, 2_500_000, not_before_us=3_500_000)
    assert gate.admit(follow_up, 0) is None  # its DLO will have been started by then
    assert gate.due(3 * SECOND) == [ahead]
    assert gate.still_valid(ahead, 3 * SECOND)


def test_retired_dlo_is_unknown(gate: CorrectionGate[str]) -> None:
    gate.retired(0)
    assert gate.admit(correction(0, 4 * SECOND), 5 * SECOND) is RejectReason.UNKNOWN_ID


def test_history_holds_a_state_until_the_next_and_keeps_the_one_that_spans_the_start() -> None:
    history: StateHistory[str] = StateHistory(span_us=100)
    history.record(0, "first")
    history.record(50, "second")
    history.record(500, "third")
    assert history.oldest_us == 50
    assert [history.at(t) for t in (0, 49, 50, 499, 500, 10_000)] == [None, None, "second", "second", "third", "third"]
    history.record(500, "third again")
    assert history.at(500) == "third again"
    assert len(history) == 2


def test_history_rewinds_when_time_does() -> None:
    history: StateHistory[str] = StateHistory(span_us=100)
    for t in (0, 50, 60):
        history.record(t, f"before, {t}")
    history.record(50, "after the clock was set back")
    assert history.at(60) == "after the clock was set back"
    history.record(70, "next")
    assert history.at(69) == "after the clock was set back"


def test_history_stays_bounded_over_a_long_run() -> None:
    history: StateHistory[int] = StateHistory(span_us=100)
    for t in range(20_000):
        history.record(t, t)
    assert len(history) == 101
    assert history.at(19_900) == 19_900
    assert len(list(history)) == 101


def test_revision_changes_what_held_at_the_time_and_everything_after() -> None:
    history: StateHistory[int] = StateHistory()
    for t in (0, 10, 20, 30):
        history.record(t, 0)
    history.revise(15, lambda state: state + 1)
    assert [state for _, state in history] == [0, 1, 1, 1]
