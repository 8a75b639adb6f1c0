"""Cost and behaviour under load: a made-up scene with more and more cables and events, on one processor core.

Time is virtual: a batch arrives when its last microsecond is over on the event clock, and everything that the event
path does with it (decoding, tracking, the message, fusion) takes the processor time that it really took. What has
arrived meanwhile waits in the tracker daemon's own queue, :class:`motiondlo.tracking.backlog.Backlog`, so that sharing
of publications, drops and latency come out as on a core that does nothing else.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from time import thread_time_ns
from typing import Any

import numpy as np
import numpy.typing as npt

from motiondlo.events.evt3 import Evt3Decoder
from motiondlo.events.surface import TimeSurface
from motiondlo.events.types import EventBatch
from motiondlo.frames.types import Appearance, EndKind, Instance, Segmentation
from motiondlo.fusion.core import FusionCore
from motiondlo.fusion.params import FusionParams
from motiondlo.offline.bench import (
    TRANSFER_BYTES,
    decoded_batches,
    frozen_garbage_collector,
    percentiles,
    published,
)
from motiondlo.offline.hybrid_loop import FrameBranch, HybridLoop
from motiondlo.offline.nearest import places_on
from motiondlo.offline.progress import Progress, no_progress
from motiondlo.offline.sweep_scene import DIAMETER_PX, SweepScene
from motiondlo.recording.layout import FrameEntry
from motiondlo.tracking.backlog import Backlog, Waiting
from motiondlo.tracking.factory import make_tracker, warm_up
from motiondlo.tracking.types import TrackUpdate

FloatArray = npt.NDArray[np.float64]

DLOS = (1, 2, 4, 8)
RATES_HZ = (1e6, 5e6, 10e6, 20e6, 30e6)
_DURATION_US = 320_000
_WARM_UP_US = 40_000


@dataclass
class Point:
    """One scene's outcome."""

    dlos: int
    rate_hz: float
    seconds: float
    """Length of the scene on the event clock."""
    events: int
    decode_surface_hz: float = 0.0
    """Events per second of processor time for decoding and the time surface alone."""
    update_ns: list[int] = field(default_factory=list)
    """Processor time of every update, all of its stages."""
    stages_ns: dict[str, int] = field(default_factory=dict)
    """Sum over the scene."""
    latency_us: list[float] = field(default_factory=list)
    """Of every publication: from its newest event's arrival to its end."""
    backlog_most: int = 0
    """Most batches that waited at once."""
    backlog_end: int = 0
    """Batches that waited when the last one arrived."""
    dropped_batches: int = 0
    dropped_events: int = 0
    error_px: list[float] = field(default_factory=list)
    """Mean distance to the true curve of every DLO at every publication."""

    @property
    def load(self) -> float:
        """Processor seconds per second of events; above 1 a core cannot keep up."""
        return sum(self.stages_ns.values()) * 1e-9 / self.seconds

    def book(self, stage: str, ns: int) -> None:
        """Add to a stage."""
        self.stages_ns[stage] = self.stages_ns.get(stage, 0) + ns

    def as_json(self) -> dict[str, Any]:
        """One entry of ``bench --sweep --json``."""
        batches = max(len(self.update_ns) + self.dropped_batches, 1)
        errors = np.array(self.error_px)
        return {
            "dlos": self.dlos,
            "rate_hz": self.rate_hz,
            "events": self.events,
            "update_ms": percentiles(np.array(self.update_ns) / 1e6),
            "load": round(self.load, 4),
            "stages_ms": {name: round(ns / 1e6 / batches, 4) for name, ns in self.stages_ns.items()},
            "decode_surface_events_per_s": round(self.decode_surface_hz),
            "latency_ms": percentiles(np.array(self.latency_us) / 1e3),
            "backlog_batches": {"most": self.backlog_most, "end": self.backlog_end},
            "dropped_batches": self.dropped_batches,
            "dropped_events": self.dropped_events,
            "error_px": {
                "mean": round(float(errors.mean()), 3) if len(errors) else None,
                "max": round(float(errors.max()), 3) if len(errors) else None,
            },
        }


@dataclass(frozen=True)
class Fit:
    """``load = fixed + per_mev * (Mev/s) + per_dlo * DLOs``: least squares over the scenes without drops."""

    fixed: float
    per_mev: float
    per_dlo: float
    r2: float
    points: int

    def as_json(self) -> dict[str, float]:
        """Rounded."""
        return {name: round(value, 5) for name, value in vars(self).items()}


def fit_load(points: Sequence[Point]) -> Fit | None:
    """How the load grows; None with fewer than four points without drops."""
    kept = [point for point in points if not point.dropped_batches]
    if len(kept) < 4:
        return None
    a = np.array([[1.0, point.events / point.seconds / 1e6, point.dlos] for point in kept])
    load = np.array([point.load for point in kept])
    solution = np.linalg.lstsq(a, load, rcond=None)[0]
    left = float(((load - a @ solution) ** 2).sum())
    spread = float(((load - load.mean()) ** 2).sum())
    r2 = 1.0 - left / spread if spread > 0.0 else 1.0
    return Fit(float(solution[0]), float(solution[1]), float(solution[2]), r2, len(kept))


def sweep(
    profile: str,
    period_us: int,
    dlos: Sequence[int] = DLOS,
    rates_hz: Sequence[float] = RATES_HZ,
    duration_us: int = _DURATION_US,
    progress: Progress = no_progress,
) -> list[Point]:
    """Every combination; the kernels are compiled before the first."""
    scene = SweepScene(1, 1e6, _WARM_UP_US)
    warm_up(profile, {}, scene.geometry)
    measure_point(scene, profile, period_us)
    points = []
    for count in dlos:
        for rate_hz in rates_hz:
            points.append(measure_point(SweepScene(count, rate_hz, duration_us), profile, period_us))
            progress(len(points) / (len(dlos) * len(rates_hz)))
    return points


def measure_point(scene: SweepScene, profile: str, period_us: int, backlog: Backlog | None = None) -> Point:
    """Run one scene; ``backlog``: another policy than a cell's own."""
    words, events = scene.raw()
    raw = [words[k : k + TRANSFER_BYTES] for k in range(0, len(words), TRANSFER_BYTES)]
    point = Point(scene.dlos, scene.rate_hz, scene.duration_us * 1e-6, events)
    with frozen_garbage_collector():
        point.decode_surface_hz = _decode_surface_hz(scene, raw, events, period_us)
        batches = decoded_batches(Evt3Decoder(scene.geometry), raw, period_us)
        _play(scene, profile, batches, period_us, Backlog() if backlog is None else backlog, point)
    return point


def _decode_surface_hz(scene: SweepScene, raw: list[bytes], events: int, period_us: int) -> float:
    surface = TimeSurface(scene.geometry)
    began_ns = thread_time_ns()
    for batch in decoded_batches(Evt3Decoder(scene.geometry), raw, period_us):
        surface.update(batch.events)
    return events / max((thread_time_ns() - began_ns) * 1e-9, 1e-9)


def _play(
    scene: SweepScene, profile: str, batches: Iterator[EventBatch], period_us: int, backlog: Backlog, point: Point
) -> None:
    tracker = make_tracker(profile, {}, scene.geometry, timed=True)
    loop = HybridLoop(tracker, FusionCore(FusionParams()), _true_shapes(scene))
    loop.start(0)
    now_us, due_us, more = 0.0, float(period_us), True
    while more or len(backlog):
        if not len(backlog):
            now_us = max(now_us, due_us)  # idle until the next batch is complete
        while more and due_us <= now_us:
            began_ns = thread_time_ns()
            batch = next(batches, None)
            spent_ns = thread_time_ns() - began_ns
            point.book("decode", spent_ns)
            now_us += spent_ns * 1e-3
            more = batch is not None
            if batch is not None:
                due_us = float(batch.t1_us + period_us)
                backlog.push(batch, batch.t1_us * 1000)
                point.backlog_most = max(point.backlog_most, len(backlog))
            else:
                point.backlog_end = len(backlog)
        taken = backlog.take()
        if taken:
            spent_ns, update = _publication(loop, taken, point)
            now_us += spent_ns * 1e-3
            point.latency_us.append(now_us - taken[-1].batch.t1_us)
            _judge(scene, update, point)
    point.dropped_batches, point.dropped_events = backlog.dropped_batches, backlog.dropped_events


def _publication(loop: HybridLoop, taken: list[Waiting], point: Point) -> tuple[int, TrackUpdate]:
    """One publication's processor time, booked by stage, and its last update."""
    total_ns = 0
    for k, waiting in enumerate(taken):
        began_ns = thread_time_ns()
        loop.deliver(waiting.batch.t1_us)
        update = loop.track(waiting.batch)
        tracked_ns = thread_time_ns()
        staged_ns = sum(update.stages_ns.values())
        scale = (tracked_ns - began_ns) / max(staged_ns, 1)
        for name, ns in update.stages_ns.items():
            point.book(name, round(ns * scale))  # the tracker tells wall time: its shares, of processor time
        if not update.stages_ns:
            point.book("tracker", tracked_ns - began_ns)
        if k == len(taken) - 1:
            published(update)
            published_ns = thread_time_ns()
            point.book("publication", published_ns - tracked_ns)
            loop.fuse(update)
            point.book("fusion", thread_time_ns() - published_ns)
        spent_ns = thread_time_ns() - began_ns
        point.update_ns.append(spent_ns)
        total_ns += spent_ns
    return total_ns, update


def _judge(scene: SweepScene, update: TrackUpdate, point: Point) -> None:
    for track in update.tracks:
        if track.id < scene.dlos:
            truth = scene.nodes(track.id, update.t_us)
            point.error_px.append(float(places_on(truth[None], track.nodes[None]).distance.mean()))


def _true_shapes(scene: SweepScene) -> FrameBranch:
    """A frame branch whose only frame shows the truth at the start."""
    instances = []
    for cable in range(scene.dlos):
        nodes = scene.nodes(cable, 0)
        instances.append(
            Instance(
                nodes_rgb=nodes,
                nodes_event=nodes,
                sigma_px=np.full(len(nodes), 0.5),
                width_rgb_px=DIAMETER_PX,
                diameter_px=DIAMETER_PX,
                score=1.0,
                ends=(EndKind.TIP, EndKind.TIP),
                appearance=_bright_tube(nodes),
            )
        )
    shapes = Segmentation(0, "truth", tuple(instances), backend="sweep")
    return FrameBranch((FrameEntry("truth", Path(), 0),), lambda entry: shapes, latency_us=0)


def _bright_tube(nodes: FloatArray) -> Appearance:
    length_px = float(np.hypot(*np.diff(nodes, axis=0).T).sum())
    across = np.abs(np.arange(-20, 21))
    row = np.full(across.shape, np.log(0.15), np.float32)
    row[across <= 0.5 * DIAMETER_PX] = np.log(0.6)
    strip = np.tile(row, (int((length_px + 40.0) / 2.0), 1))
    return Appearance(strip, np.ones(strip.shape, np.uint8), s0_px=-20.0)
