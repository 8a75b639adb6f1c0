"""A replay begins when the tracker has the first shapes, or when there will be none."""

from __future__ import annotations

from motiondlo.messages.health import HealthMessage
from motiondlo_services.event_ingest.readiness import MAX_FAILURES, TrackerReadiness


def health(daemon: str, **info: int) -> HealthMessage:
    return HealthMessage(daemon=daemon, lifecycle="running", ready=True, uptime_s=1.0, info=dict(info))


def test_ready_once_every_shape_sent_was_taken() -> None:
    readiness = TrackerReadiness()
    for daemon in ("segmenter", "frame-capture"):
        readiness.on_health(health(daemon))
    readiness.on_health(health("event-tracker", corrections=0))
    readiness.on_health(health("fusion", corrections=2))
    readiness.on_health(health("event-tracker", corrections=1))
    assert not readiness.ready
    assert "tracker" in readiness.missing
    readiness.on_health(health("event-tracker", corrections=2))
    assert readiness.ready
    assert readiness.missing == ""


def test_what_is_missing_is_named_in_order() -> None:
    readiness = TrackerReadiness()
    assert readiness.missing == "event-tracker to start"
    for daemon in ("event-tracker", "fusion", "frame-capture"):
        readiness.on_health(health(daemon))
    assert readiness.missing == "segmenter to start"
    readiness.on_health(health("segmenter"))
    assert readiness.missing == "the first segmentation"


def test_a_scene_that_cannot_be_segmented_is_played_all_the_same() -> None:
    readiness = TrackerReadiness()
    readiness.on_health(health("fusion", corrections=0, failed_segmentations=MAX_FAILURES))
    assert readiness.decided
    assert not readiness.ready
