"""Batches on a fixed grid."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from tests.common.events.encoding import make_events, make_triggers, random_events

from motiondlo.events.cutter import MAX_SILENCE_US, BatchCutter
from motiondlo.events.joining import join
from motiondlo.events.types import EventBatch, empty_events, empty_triggers


def at(*times_us: int) -> np.ndarray:
    return make_events((t, 1, 1, 1) for t in times_us)


def cut(cutter: BatchCutter, *pushes: tuple[np.ndarray, int]) -> list[EventBatch]:
    batches = []
    for events, now_us in pushes:
        batches += cutter.push(events, empty_triggers(), now_us)
    return batches + list(cutter.finish())


def test_edges_belong_to_the_later_batch() -> None:
    batches = cut(BatchCutter(1000), (at(0, 999, 1000, 2999), 3000))
    assert [(b.t0_us, b.t1_us, b.events["t"].tolist()) for b in batches] == [
        (0, 1000, [0, 999]),
        (1000, 2000, [1000]),
        (2000, 3000, [2999]),
    ]


def test_silence_gives_empty_batches() -> None:
    cutter = BatchCutter(1000)
    assert [len(b.events) for b in cutter.push(at(100), empty_triggers(), 4500)] == [1, 0, 0, 0]
    assert [len(b.events) for b in cutter.push(empty_events(), empty_triggers(), 6000)] == [0, 0]
    assert list(cutter.push(empty_events(), empty_triggers(), 6999)) == []


def test_a_batch_is_not_finished_before_its_time_is_over() -> None:
    cutter = BatchCutter(1000)
    assert list(cutter.push(at(100, 200), empty_triggers(), 900)) == []
    (batch,) = cutter.push(at(950, 1010), empty_triggers(), 1000)
    assert batch.events["t"].tolist() == [100, 200, 950]
    (last,) = cutter.push(empty_events(), empty_triggers(), 2000)
    assert last.events["t"].tolist() == [1010]


def test_triggers_travel_in_the_batch_they_belong_to() -> None:
    cutter = BatchCutter(1000)
    batches = list(cutter.push(at(1500), make_triggers([(999, 0, 1), (1000, 0, 0), (2500, 0, 1)]), 2000))
    batches += cutter.finish()
    assert [b.triggers["t"].tolist() for b in batches] == [[999], [1000], [2500]]


def test_a_stream_that_begins_late_starts_with_its_first_event() -> None:
    assert cut(BatchCutter(1000), (at(913_716_123), 913_716_200))[0].t0_us == 913_716_000
    assert cut(BatchCutter(1000), (at(900_123), 900_200))[0].t0_us == 0


def test_start_leaves_out_what_is_earlier() -> None:
    batches = cut(BatchCutter(1000, start_us=2500), (at(100, 1900, 2100, 3000), 4000))
    assert [(b.t0_us, b.events["t"].tolist()) for b in batches] == [(2000, [2100]), (3000, [3000])]


def test_very_long_silence_is_skipped_and_told() -> None:
    late_us = MAX_SILENCE_US + 5_000_400
    batches = cut(BatchCutter(1000), (at(10, late_us), late_us + 700))
    assert [b.lost_before for b in batches] == [0, 15_000 - 1]
    assert batches[-1].t0_us == late_us - 400
    assert batches[-1].events["t"].tolist() == [late_us]


def test_nothing_at_all_gives_no_batch() -> None:
    assert cut(BatchCutter(1000), (empty_events(), -1)) == []


def test_a_start_that_lies_many_pieces_ahead_begins_with_its_own_batch() -> None:
    batches = cut(BatchCutter(1000, 5000), (at(100, 900), 1000), (at(2500, 4999), 5000), (at(5001, 6200), 7000))
    assert [(b.t0_us, b.events["t"].tolist()) for b in batches] == [(5000, [5001]), (6000, [6200])]


def test_a_period_must_be_positive() -> None:
    with pytest.raises(ValueError, match="period_us"):
        BatchCutter(0)


@settings(max_examples=60, deadline=None)
@given(st.lists(st.integers(0, 400), max_size=12), st.sampled_from([200, 1000, 5000, 333]), st.integers(0, 3))
def test_cutting_loses_nothing_and_does_not_depend_on_the_pieces(sizes: list[int], period_us: int, seed: int) -> None:
    events = random_events(sum(sizes), seed, mean_step_us=7.0)
    cutter = BatchCutter(period_us)
    batches, start = [], 0
    for size in sizes:
        piece = events[start : start + size]
        start += size
        now_us = int(events["t"][start]) if start < len(events) else int(events["t"][-1]) if start else 0
        batches += cutter.push(piece, empty_triggers(), now_us)
    batches += cutter.finish()
    whole = cut(BatchCutter(period_us), (events, int(events["t"][-1]) if len(events) else 0))
    assert [(b.t0_us, len(b.events)) for b in batches] == [(b.t0_us, len(b.events)) for b in whole]
    if len(events):
        np.testing.assert_array_equal(join([b.events for b in batches]), events)
    for b in batches:
        assert b.t1_us - b.t0_us == period_us
        assert b.t0_us % period_us == 0
        assert not len(b.events) or (b.events["t"][0] >= b.t0_us and b.events["t"][-1] < b.t1_us)
