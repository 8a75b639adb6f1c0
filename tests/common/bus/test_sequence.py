"""Gaps, repeats and restarts are told apart."""

from __future__ import annotations

from motiondlo.bus.sequence import REORDERED_AT_MOST, SequenceLedger


def test_an_unbroken_sequence_loses_nothing_wherever_it_begins() -> None:
    ledger = SequenceLedger()
    assert [ledger.note("a", seq, seq * 10) for seq in range(500, 510)] == [0] * 10
    assert (ledger.received, ledger.lost, ledger.repeated) == (10, 0, 0)


def test_a_gap_is_counted_just_before_the_message_that_shows_it() -> None:
    ledger = SequenceLedger()
    assert [ledger.note("a", seq, seq) for seq in (0, 1, 5, 6)] == [0, 0, 3, 0]
    assert ledger.lost == 3


def test_repeats_and_late_messages_are_refused() -> None:
    ledger = SequenceLedger()
    assert [ledger.note("a", seq, seq) for seq in (0, 1, 1, 0, 2)] == [0, 0, -1, -1, 0]
    assert (ledger.repeated, ledger.lost, ledger.received) == (2, 0, 3)


def test_a_sender_that_restarted_begins_anew() -> None:
    ledger = SequenceLedger()
    ledger.note("a", 1000, 5_000)
    assert [ledger.note("a", seq, 6_000 + seq) for seq in (0, 1, 2)] == [0, 0, 0]
    assert (ledger.restarts, ledger.lost, ledger.repeated) == (1, 0, 0)


def test_a_sender_whose_host_restarted_is_believed_after_a_few_messages() -> None:
    ledger = SequenceLedger()
    ledger.note("a", 1000, 5_000_000)
    verdicts = [ledger.note("a", seq, seq) for seq in range(REORDERED_AT_MOST + 3)]
    assert verdicts == [-1] * REORDERED_AT_MOST + [0, 0, 0]
    assert ledger.restarts == 1


def test_senders_do_not_mix() -> None:
    ledger = SequenceLedger()
    for seq in range(3):
        assert ledger.note("a", seq, seq) == 0
        assert ledger.note("b", seq + 70, seq) == 0
    assert ledger.lost == 0
