"""Gaps in a periodic trigger line."""

from __future__ import annotations

from tests.common.events.encoding import make_triggers

from motiondlo.events.trigger_monitor import TriggerMonitor

PERIOD_US = 50_000


def exposures(*indices: int, jitter_us: int = 3) -> list[tuple[int, int, int]]:
    """Rising and falling edges of the frames with these numbers."""
    rows = []
    for i in indices:
        t_us = i * PERIOD_US + (i * 7919) % jitter_us
        rows += [(t_us, 0, 1), (t_us + 5000, 0, 0)]
    return rows


def test_a_complete_line_has_no_gaps() -> None:
    monitor = TriggerMonitor()
    assert monitor.push(make_triggers(exposures(*range(20)))) == 0
    assert (monitor.triggers, monitor.missed, monitor.gaps) == (40, 0, [])
    assert abs(monitor.period_us - PERIOD_US) <= 3


def test_TRIGGER_MISSING_is_counted_once_per_frame() -> None:
    monitor = TriggerMonitor()
    assert monitor.push(make_triggers(exposures(0, 1, 2, 3, 4))) == 0
    assert monitor.push(make_triggers(exposures(7, 8))) == 2
    assert len(monitor.gaps) == 1
    assert monitor.push(make_triggers(exposures(9, 11))) == 1
    assert abs(monitor.period_us - PERIOD_US) <= 3


def test_EDGE_MISSING_shows_as_two_of_a_kind() -> None:
    rows = exposures(*range(8))
    del rows[7]
    monitor = TriggerMonitor()
    assert monitor.push(make_triggers(rows)) == 1
    rows = exposures(*range(8))
    del rows[8]
    assert TriggerMonitor().push(make_triggers(rows)) == 2  # the rising edge, and the frame that it would have begun


def test_other_channels_are_ignored() -> None:
    monitor = TriggerMonitor(channel=0)
    monitor.push(make_triggers([(5, 1, 1), (6, 1, 1)]))
    assert (monitor.triggers, monitor.missed) == (0, 0)
