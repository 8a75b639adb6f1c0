"""The cell's loop without processes: batches through tracker and fusion, segmentations that arrive late in event time.

Deterministic: the order of everything follows from the data's own times, and no clock is read. A segmentation of a
frame is used ``latency_us`` after it was asked for (or after its frame was taken, if that is later), as in a live cell;
only the first frame's is there at the start, because the scene was at rest before a recording begins.
"""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Callable
from dataclasses import dataclass

from motiondlo.events.types import EventBatch
from motiondlo.frames.types import Segmentation
from motiondlo.fusion.core import FusionCore
from motiondlo.fusion.state import FrameRequest, FusedState
from motiondlo.recording.layout import FrameEntry
from motiondlo.rejects import RejectCounter
from motiondlo.tracking.types import Correction, EventTracker, TrackUpdate

Segment = Callable[[FrameEntry], Segmentation]


@dataclass(frozen=True)
class FrameBranch:
    """Frames by trigger time, how one is segmented, and when the result is there."""

    frames: tuple[FrameEntry, ...]
    segment: Segment
    latency_us: int
    ask_always: bool = False
    """Ask for the newest frame whenever no segmentation is under way, instead of when fusion wants one."""


@dataclass(frozen=True)
class _Underway:
    segmentation: Segmentation
    due_us: int
    number: int | None


class HybridLoop:
    """Feed batches to :meth:`deliver`, :meth:`track`, :meth:`fuse` and :meth:`ask`, in this order, or to :meth:`step`.

    The four are apart so that a benchmark can time them one by one.
    """

    def __init__(self, tracker: EventTracker, fusion: FusionCore, frame_branch: FrameBranch | None) -> None:
        self._tracker = tracker
        self._fusion = fusion
        self._branch = frame_branch
        self._frame_times_us = [entry.t_us for entry in frame_branch.frames] if frame_branch is not None else []
        self._wanted: FrameRequest | None = None
        self._underway: _Underway | None = None
        self._last_frame: FrameEntry | None = None
        self.segmented = 0
        self.failures: list[str] = []
        self.rejects = RejectCounter()

    @property
    def refused_shapes(self) -> dict[str, int]:
        """Shapes that fusion did not use, per reason."""
        return self._fusion.rejects.as_dict()

    def start(self, now_us: int) -> None:
        """Before the first batch, which begins at ``now_us``: the first frame's segmentation is there."""
        if self._branch is None or not self._branch.frames:
            return
        if self._fusion.frame_request() is not None or self._branch.ask_always:
            self._take(self._segmented(self._branch.frames[0]), now_us)

    def step(self, batch: EventBatch) -> FusedState:
        """One update: the fused state at ``batch.t1_us``."""
        self.deliver(batch.t1_us)
        state = self.fuse(self.track(batch))
        self.ask(batch.t1_us)
        return state

    def deliver(self, now_us: int) -> None:
        """Hand fusion the segmentation that has arrived by ``now_us``, and its corrections to the tracker."""
        if self._underway is not None and self._underway.due_us <= now_us:
            arrived, self._underway = self._underway, None
            self._take(arrived.segmentation, now_us, arrived.number)

    def track(self, batch: EventBatch) -> TrackUpdate:
        """Advance the tracker to the batch's end."""
        return self._tracker.update(batch)

    def fuse(self, update: TrackUpdate) -> FusedState:
        """Advance fusion; corrections that follow from the update go back to the tracker."""
        state = self._fusion.on_track(update)
        self._correct(self._fusion.corrections_due())
        return state

    def ask(self, now_us: int) -> None:
        """Start a segmentation if fusion wants one and a frame for it was taken by ``now_us``."""
        if self._branch is None:
            return
        request = self._fusion.frame_request()
        if self._branch.ask_always:
            after_us = -1 if self._last_frame is None else self._last_frame.t_us + 1
            request = FrameRequest("always", after_us) if self._underway is None else None
        if request is not None:
            self._wanted = request
        elif self._wanted is not None and not self._branch.ask_always and not self._fusion.awaits(self._wanted):
            self._wanted = None  # cancelled before there was a frame for it
        if self._wanted is None or self._underway is not None:
            return  # the segmenter does one frame at a time
        k = bisect_right(self._frame_times_us, now_us) - 1
        if k < 0 or self._frame_times_us[k] < self._wanted.after_us:
            return
        number, self._wanted = self._wanted.number or None, None
        entry = self._branch.frames[k]
        self._underway = _Underway(self._segmented(entry), now_us + self._branch.latency_us, number)

    def _segmented(self, entry: FrameEntry) -> Segmentation:
        assert self._branch is not None
        self._last_frame = entry
        segmentation = self._branch.segment(entry)
        self.segmented += 1
        if segmentation.failure:
            self.failures.append(f"{entry.name}: {segmentation.failure}")
        return segmentation

    def _take(self, segmentation: Segmentation, now_us: int, number: int | None = None) -> None:
        self._correct(self._fusion.on_segmentation(segmentation, now_us, number))

    def _correct(self, corrections: tuple[Correction, ...]) -> None:
        for correction in corrections:
            reason = self._tracker.correct(correction)
            if reason is not None:
                self.rejects.count(reason)
