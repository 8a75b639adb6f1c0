"""A camera that goes is reported at once, and comes back without being asked."""

from __future__ import annotations

import pytest
from tests.common.cameras.fakes import Clock, FakeCamera

from motiondlo.cameras.link import BACKOFF_MAX_S, CameraLink


def follow(link: CameraLink, clock: Clock, until_s: float) -> list[tuple[float, bool, str]]:  # type: ignore[type-arg]
    """Read until ``until_s``; (time, connected, problem) whenever that changed."""
    changes: list[tuple[float, bool, str]] = []
    while clock.s < until_s:
        link.read(0.05)
        report = link.report
        if not changes or changes[-1][1:] != (report.connected, report.problem):
            changes.append((clock.s, report.connected, report.problem))
        clock.sleep(min(link.pause_s, 0.1) if not report.connected else 0.0)
    return changes


def test_UNPLUGGED_is_reported_within_a_second_and_reconnected() -> None:
    clock = Clock(0.0)
    camera = FakeCamera(clock, unplugged=(3.0, 9.0))
    link = CameraLink(camera, stall_s=0.5, now_ns=clock.ns)
    changes = follow(link, clock, 15.0)
    assert [(connected, problem) for _, connected, problem in changes] == [
        (True, ""),
        (False, "fake camera: unplugged"),
        (True, ""),
    ]
    assert changes[1][0] - 3.0 < 0.1
    assert 0.0 <= changes[2][0] - 9.0 <= BACKOFF_MAX_S + 0.2
    attempts = [t for t in camera.opened_at if 3.0 <= t < 9.0]
    assert len(attempts) < 8, "with back-off, not without a pause"
    assert link.report.outages == 1
    assert link.report.connections == 2


def test_SILENT_camera_counts_as_lost_within_a_second() -> None:
    clock = Clock(0.0)
    camera = FakeCamera(clock, silent_from=2.0)
    link = CameraLink(camera, stall_s=0.5, now_ns=clock.ns)
    changes = follow(link, clock, 2.9)
    assert not changes[1][1]
    assert changes[1][2].startswith("fake camera: silent for 0.5")
    assert changes[1][0] < 3.0
    assert camera.closed


def test_SILENCE_is_no_fault_where_triggers_come_on_demand() -> None:
    clock = Clock(0.0)
    link = CameraLink(FakeCamera(clock, silent_from=2.0), stall_s=0.0, now_ns=clock.ns)
    follow(link, clock, 20.0)
    assert link.report.connected
    assert link.report.outages == 0


def test_NOT_THERE_AT_THE_START_is_one_outage_and_no_error() -> None:
    clock = Clock(0.0)
    link = CameraLink(FakeCamera(clock, unplugged=(0.0, 4.0)), stall_s=0.5, now_ns=clock.ns)
    assert link.read(0.05) is None
    assert link.report.problem == "fake camera: unplugged"
    assert link.pause_s == pytest.approx(0.2)
    follow(link, clock, 8.0)
    assert link.report.connected
    assert link.report.outages == 1
