"""Time per update and per stage of the offline loop.

What counts is what the event path does for each batch: decoding, the tracker's stages, writing its message, fusion.
Segmenting frames does not (another process does it in a cell), nor does compilation: a first pass over the recording's
beginning is not timed.
"""

from __future__ import annotations

import gc
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from time import perf_counter_ns, thread_time_ns
from typing import Any

import numpy as np
import numpy.typing as npt

from motiondlo.events.cutter import BatchCutter
from motiondlo.events.reader import make_decoder
from motiondlo.events.stream_decoder import StreamDecoder
from motiondlo.events.types import EventBatch
from motiondlo.heap import EVENTS_STOCK_BYTES, keep_memory
from motiondlo.messages import wire
from motiondlo.messages.header import Stamp
from motiondlo.messages.track import TrackMessage
from motiondlo.offline.options import TrackOptions
from motiondlo.offline.progress import Progress, no_progress
from motiondlo.offline.run_track import prepare
from motiondlo.recording.layout import Recording
from motiondlo.tracking.types import TrackUpdate

Int64Array = npt.NDArray[np.int64]

WARM_UP_UPDATES = 3000
_STAMP = Stamp(seq=1, cell="bench", source="event-tracker", t_sent_ns=0)
_LAST = ("publication", "fusion")
_ELSEWHERE = ("decode", "fusion")
"""Stages that run in processes of their own in a cell: what is left of an update is the work of the tracker's core."""
# About what a camera's transfer holds; larger pieces would book the decoding of many batches to one of them.
TRANSFER_BYTES = 1 << 13


@dataclass(frozen=True)
class Timing:
    """Host times of N updates."""

    total_ns: Int64Array
    """(N,) one whole update."""
    cpu_ns: Int64Array
    """(N,) processor time of one whole update: without what other processes on a busy machine took."""
    moving: npt.NDArray[np.bool_]
    """(N,) whether some DLO was moving."""
    stages_ns: dict[str, Int64Array]
    """(N,) per stage; 0 where an update had no use for it."""
    events: int

    def as_json(self) -> dict[str, Any]:
        """The profile's entry of ``bench --json``; stages in the order in which they run."""
        update_ms = self.total_ns / 1e6
        return {
            "updates": len(update_ms),
            "update_ms": percentiles(update_ms),
            "update_moving_ms": percentiles(update_ms[self.moving]),
            "update_cpu_ms": percentiles(self.cpu_ns / 1e6),
            "update_tracker_ms": percentiles(update_ms - sum(self.stages_ns[name] for name in _ELSEWHERE) / 1e6),
            "stages_ms": self._stages(np.ones(len(update_ms), np.bool_)),
            "stages_moving_ms": self._stages(self.moving),
            "events": self.events,
            "events_per_s": round(self.events / max(self.total_ns.sum() / 1e9, 1e-9)),
        }

    def _stages(self, use: npt.NDArray[np.bool_]) -> dict[str, dict[str, float | None]]:
        return {
            name: {key: value for key, value in percentiles(ns[use] / 1e6).items() if key != "max"}
            for name, ns in self.stages_ns.items()
        }


def percentiles(values_ms: npt.NDArray[np.float64]) -> dict[str, float | None]:
    """``p50``, ``p99`` and ``max`` in ms, rounded to 0.1 us; None without values."""
    if not len(values_ms):
        return {"p50": None, "p99": None, "max": None}
    p50, p99 = np.percentile(values_ms, [50, 99])
    return {"p50": round(float(p50), 4), "p99": round(float(p99), 4), "max": round(float(values_ms.max()), 4)}


def measure(recording: Recording, options: TrackOptions, progress: Progress = no_progress) -> Timing:
    """Time every update of a recording. Raises as :func:`motiondlo.offline.run_track.prepare`."""
    options = replace(options, timed=True)
    prepare(recording, options)  # wrong options fail before the warm-up
    keep_memory(EVENTS_STOCK_BYTES)  # as the daemons do
    _pass(recording, options, WARM_UP_UPDATES, lambda share: progress(0.5 * share))
    with frozen_garbage_collector():
        return _pass(recording, options, None, lambda share: progress(0.5 + 0.5 * share))


def _pass(recording: Recording, options: TrackOptions, limit: int | None, progress: Progress) -> Timing:
    run = prepare(recording, options)
    raw = list(run.events.raw_chunks(TRANSFER_BYTES))
    batches = decoded_batches(make_decoder(run.events.header, run.events.geometry), raw, options.update_us)
    loop = run.loop
    totals: list[int] = []
    cpu: list[int] = []
    moving: list[bool] = []
    stages: dict[str, list[int]] = {}
    order: list[str] = []
    events = 0
    while limit is None or len(totals) < limit:
        cpu_began_ns = thread_time_ns()
        began_ns = perf_counter_ns()
        batch = next(batches, None)
        decoded_ns = perf_counter_ns()
        if batch is None:
            break
        if not totals:
            loop.start(batch.t0_us)
            cpu_began_ns = thread_time_ns()
        delivering_ns = perf_counter_ns()
        loop.deliver(batch.t1_us)
        delivered_ns = perf_counter_ns()
        update = loop.track(batch)
        tracked_ns = perf_counter_ns()
        published(update)
        published_ns = perf_counter_ns()
        state = loop.fuse(update)
        fused_ns = perf_counter_ns()
        cpu.append(thread_time_ns() - cpu_began_ns)
        loop.ask(batch.t1_us)  # may segment a frame: not part of the event path
        stages_now = {
            "decode": decoded_ns - began_ns,
            **update.stages_ns,
            "publication": published_ns - tracked_ns,
            "fusion": delivered_ns - delivering_ns + fused_ns - published_ns,
        }
        if len(stages_now) > len(order):
            order = list(stages_now)
        for name, ns in stages_now.items():
            stages.setdefault(name, [0] * len(totals)).append(ns)
        totals.append(decoded_ns - began_ns + fused_ns - delivering_ns)
        for absent in stages.keys() - stages_now.keys():
            stages[absent].append(0)
        moving.append(any(dlo.moving for dlo in state.dlos))
        events += len(batch.events)
        if len(totals) % 50 == 0 and run.end_us > 0:
            progress(min(batch.t1_us / run.end_us, 1.0))
    progress(1.0)
    # As in the update that had the most of them: most updates at rest skip some in the middle.
    names = sorted(dict.fromkeys([*order, *stages]), key=lambda name: _LAST.index(name) + 1 if name in _LAST else 0)
    return Timing(
        np.array(totals, np.int64),
        np.array(cpu, np.int64),
        np.array(moving, np.bool_),
        {name: np.array(stages[name], np.int64) for name in names},
        events,
    )


def published(update: TrackUpdate) -> bytes:
    """The tracker's message as it goes on the bus."""
    return wire.pack(TrackMessage.from_update(update, t_ingest_ns=0).wire_map(_STAMP))


def decoded_batches(decoder: StreamDecoder, raw: Iterable[bytes], period_us: int) -> Iterator[EventBatch]:
    """As ``EventFile.batches``, from memory and in pieces of a camera's size."""
    cutter = BatchCutter(period_us)
    for chunk in raw:
        decoded, triggers = decoder.push(chunk)
        yield from cutter.push(decoded, triggers, decoder.time_us)
    decoded, triggers = decoder.flush()
    yield from cutter.push(decoded, triggers, decoder.time_us)
    yield from cutter.finish()


@contextmanager
def frozen_garbage_collector() -> Iterator[None]:
    """The daemons freeze it too: a collection would be booked to whatever stage it interrupts."""
    enabled = gc.isenabled()
    gc.collect()
    gc.freeze()
    gc.disable()
    try:
        yield
    finally:
        gc.unfreeze()
        if enabled:
            gc.enable()
