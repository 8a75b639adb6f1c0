"""One real message of each kind, for all tests of messages."""

from __future__ import annotations

import numpy as np

from motiondlo.events.types import EVENT_DTYPE, TRIGGER_DTYPE, EventArray, EventBatch
from motiondlo.frames.types import Appearance, EndKind, Instance, Segmentation
from motiondlo.messages.command import CommandAnswer, CommandRequest
from motiondlo.messages.correction import CorrectionMessage
from motiondlo.messages.events import ClockMessage, EventBatchMessage, TriggerMessage
from motiondlo.messages.frame import FrameMessage
from motiondlo.messages.header import Message, Stamp
from motiondlo.messages.health import HealthMessage, Quantiles
from motiondlo.messages.reject import Expectation
from motiondlo.messages.segmentation import SegmentationMessage
from motiondlo.messages.state import StateDlo, StateMessage
from motiondlo.messages.track import TrackMessage
from motiondlo.tracking.types import Correction, CorrectionKind, TrackSource, TrackState, TrackUpdate

NOW_NS = 5_000_000_000
STAMP = Stamp(seq=7, cell="cell1", source="sender", t_sent_ns=NOW_NS - 100_000)
EXPECT = Expectation(cell="cell1", now_ns=NOW_NS, horizon_us=2_000_000, max_payload_bytes=1 << 24)
M = 5


def points(m: int = M) -> np.ndarray:
    """(m, 2) float64."""
    return np.stack([np.linspace(100.0, 400.0, m), np.linspace(50.0, 90.0, m)], axis=1)


def events(n: int = 4) -> EventArray:
    """n events in order within [1_000_000, 1_001_000) us."""
    array = np.zeros(n, EVENT_DTYPE)
    array["t"] = np.sort(np.linspace(1_000_000, 1_000_999, n).astype(np.int64)) if n else array["t"]
    array["x"] = np.arange(n) % 1280
    array["y"] = np.arange(n) % 720
    array["p"] = np.arange(n) % 2
    return array


def batch(n: int = 4) -> EventBatch:
    """A batch with one trigger."""
    triggers = np.zeros(1, TRIGGER_DTYPE)
    triggers["t"], triggers["edge"] = 1_000_500, 1
    return EventBatch(1_000_000, 1_001_000, events(n), triggers, lost_before=2)


def track_state(m: int = M) -> TrackState:
    """One DLO in motion."""
    return TrackState(
        id=3,
        nodes=points(m),
        velocity_px_s=np.ones((m, 2)) * 20.0,
        cov_px2=np.ones((m, 3)) * 0.25,
        visible=np.ones(m, np.uint8),
        diameter_px=12.5,
        confidence=0.75,
        moving=True,
        source=TrackSource.EVENT,
        t_corrected_us=900_000,
        fit_px=0.5,
        reinitialised=1,
    )


def update(m: int = M) -> TrackUpdate:
    """One DLO, with stages and rejects."""
    return TrackUpdate(
        t_us=1_001_000,
        t_events_us=1_000_999,
        tracks=(track_state(m),),
        active_ratio=0.01,
        events=4,
        stages_ns={"filter": 12_000},
        rejects={"too_old": 1},
    )


def appearance() -> Appearance:
    """A strip of 6 by 3."""
    return Appearance(np.full((6, 3), -0.5, np.float32), np.ones((6, 3), np.uint8), s0_px=-4.0)


def correction() -> Correction:
    """A blend with everything in it."""
    return Correction(
        seq=11,
        id=3,
        t_us=950_000,
        kind=CorrectionKind.BLEND,
        nodes=points(),
        sigma_normal_px=np.full(M, 0.5),
        sigma_tangent_px=np.full(M, 3.0),
        diameter_px=12.5,
        ends=(EndKind.TIP, EndKind.BORDER),
        appearance=appearance(),
        not_before_us=1_950_000,
    )


def segmentation() -> Segmentation:
    """One instance with appearance, one without a homography."""
    whole = Instance(
        points(), points() * 0.5, np.full(M, 0.5), 30.0, 14.0, 0.9, (EndKind.TIP, EndKind.HELD), appearance()
    )
    bare = Instance(points(), None, np.full(M, 0.5), 30.0, 30.0, 0.4)
    return Segmentation(950_000, "frame_000002.jpg", (whole, bare), "", "classical", 812.5)


def state() -> StateMessage:
    """One DLO with millimetres."""
    dlo = StateDlo(
        id=3,
        nodes=points(),
        sigma_px=np.full(M, 0.5),
        velocity_px_s=np.ones((M, 2)) * 20.0,
        visible=np.ones(M, np.uint8),
        diameter_px=12.5,
        length_px=302.0,
        confidence=0.75,
        moving=True,
        source="event",
        t_corrected_us=900_000,
        nodes_mm=points() * 0.4,
    )
    return StateMessage(
        t_us=1_001_000,
        t_events_us=1_000_999,
        t_utc_ns=1_800_000_000_000_000_000,
        t_ingest_ns=NOW_NS - 2_000_000,
        mode="MOTION",
        dlos=(dlo,),
    )


def all_messages() -> dict[str, Message]:
    """One of each, by its name in motiondlo.messages.schemas.MODELS."""
    image = np.arange(4 * 6 * 3, dtype=np.uint8).reshape(4, 6, 3)
    return {
        "events_batch": EventBatchMessage.from_batch(batch(), NOW_NS - 2_000_000),
        "events_trigger": TriggerMessage(t_us=1_000_500, triggers=batch().triggers),
        "events_clock": ClockMessage(t_us=1_000_000, anchor_us=1_000_000, anchor_host_ns=NOW_NS, drift_ppm=20.0),
        "frame": FrameMessage(t_us=950_000, name="frame_000002.jpg", trigger_id=2, reason="request", image=image),
        "segmentation": SegmentationMessage.from_segmentation(segmentation(), "r1"),
        "track": TrackMessage.from_update(update(), NOW_NS - 2_000_000),
        "correction": CorrectionMessage.from_correction(correction()),
        "state": state(),
        "health": HealthMessage(
            daemon="sender",
            lifecycle="running",
            ready=True,
            uptime_s=2.5,
            rates_hz={"events/batch": 998.5},
            latencies_ms={"update": Quantiles(p50=0.5, p99=1.5, max=2.0)},
            drops={"events/batch.lost": 3},
            rejects={"not_finite": 1},
            versions={"motiondlo": "0.1.0"},
            info={"profile": "default", "threads": 2, "shared_memory": True},
        ),
        "command_request": CommandRequest(verb="set_region", args={"x0_px": 10, "points": (1.5, 2.5)}),
        "command_answer": CommandAnswer(verb="pause", daemon="sender", ok=False, error="busy", what_to_do="Ask later."),
    }
