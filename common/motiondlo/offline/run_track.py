"""Track a recording from end to end: deterministic, causal, as fast as it can."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path

from motiondlo.config.validation import validated
from motiondlo.errors import CalibrationError, RecordingError
from motiondlo.events.reader import EventFile, open_events
from motiondlo.events.types import SensorGeometry
from motiondlo.fusion.core import FusionCore
from motiondlo.fusion.params import FusionParams
from motiondlo.fusion.state import FusedState
from motiondlo.geometry.lens import LensModel, load_lens
from motiondlo.offline.frame_hold import FrameHoldTracker
from motiondlo.offline.frame_segmenter import FrameSegmenter
from motiondlo.offline.hybrid_loop import FrameBranch, HybridLoop
from motiondlo.offline.options import TrackMode, TrackOptions
from motiondlo.offline.progress import Progress, no_progress
from motiondlo.offline.tracks import Tracks, TracksBuilder
from motiondlo.recording.layout import Recording
from motiondlo.tracking.factory import make_tracker
from motiondlo.tracking.types import EventTracker


@dataclass
class TrackRun:
    """A recording being tracked; ``states`` drives it, the counts are final when that is used up."""

    recording: Recording
    events: EventFile
    loop: HybridLoop
    options: TrackOptions
    end_us: int
    """About where the recording ends, for progress; 0 if unknown."""
    updates: int = field(default=0, init=False)

    def states(self, progress: Progress = no_progress) -> Iterator[FusedState]:
        """The fused state after every batch."""
        for batch in self.events.batches(self.options.update_us):
            if not self.updates:
                self.loop.start(batch.t0_us)
            yield self.loop.step(batch)
            self.updates += 1
            if self.updates % 50 == 0 and self.end_us > 0:
                progress(min(batch.t1_us / self.end_us, 1.0))
        progress(1.0)

    def notes(self) -> list[str]:
        """What a person should know of the run: damage, rejects and failures, one line each."""
        counts = {
            "damage in events.raw": {kind: n for kind, n in self.events.damage.items() if n},
            "frames not used": {reason.value: n for reason, n in self.recording.rejects.items()},
            "shapes refused": self.loop.refused_shapes,
            "corrections refused": self.loop.rejects.as_dict(),
        }
        lines = [
            f"{what}: {', '.join(f'{kind} {n}' for kind, n in found.items())}"
            for what, found in counts.items()
            if found
        ]
        if profile_used(self.options) != self.options.profile:
            lines.append("without frames the paper's tracker is used: the default one begins with a frame's shape")
        if self.loop.failures:
            lines.append(f"segmentations that failed: {len(self.loop.failures)}, the last: {self.loop.failures[-1]}")
        return lines


def profile_used(options: TrackOptions) -> str:
    """The tracker's profile: without frames it is the paper's, which finds its DLO in the events by itself."""
    return "paper" if options.mode is TrackMode.EVENT else options.profile


def prepare(
    recording: Recording,
    options: TrackOptions,
    changed: Callable[[FrameBranch], FrameBranch] | None = None,
) -> TrackRun:
    """Everything that the run needs, checked before it starts; ``changed`` may put another frame branch in place.

    Raises ConfigError for a wrong option, RecordingError or CalibrationError for what the mode needs and is absent.
    """
    size = recording.camera_info.event
    geometry = None if size is None else SensorGeometry(size.width, size.height)
    events = open_events(recording.events_path, geometry)
    fusion = FusionCore(validated(FusionParams, options.fusion, "fusion"))
    branch = None if options.mode is TrackMode.EVENT else _frame_branch(recording, options, events.geometry)
    if branch is not None and changed is not None:
        branch = changed(branch)
    tracker: EventTracker = (
        FrameHoldTracker()
        if options.mode is TrackMode.FRAME
        else make_tracker(profile_used(options), options.tracker, events.geometry, timed=options.timed)
    )
    end_us = recording.frames[-1].t_us if recording.frames else 0
    return TrackRun(recording, events, HybridLoop(tracker, fusion, branch), options, end_us)


def track_recording(
    recording: Recording, options: TrackOptions | None = None, progress: Progress = no_progress
) -> Tracks:
    """Track every DLO of a recording; one row per DLO and batch. Raises as :func:`prepare`."""
    return rows_of(prepare(recording, TrackOptions() if options is None else options).states(progress))


def rows_of(states: Iterator[FusedState]) -> Tracks:
    """One row per DLO of every state."""
    builder = TracksBuilder()
    for state in states:
        for dlo in state.dlos:
            builder.add(state.t_us, dlo.id, dlo.nodes, dlo.sigma_px, dlo.source, dlo.sigma_tangent_px, dlo.confidence)
    return builder.build()


def _frame_branch(recording: Recording, options: TrackOptions, sensor: SensorGeometry) -> FrameBranch:
    if not recording.frames:
        raise RecordingError(
            f"{recording.path}: has no frames with trigger times.", "Use --mode event, which needs none."
        )
    rgb, event = recording.camera_info.rgb, (sensor.width_px, sensor.height_px)
    segmenter = FrameSegmenter(
        recording,
        options.frames,
        _lens(options.rgb_lens, None if rgb is None else (rgb.width, rgb.height)),
        _lens(options.event_lens, event),
    )
    return FrameBranch(
        frames=recording.frames,
        segment=segmenter.segment,
        latency_us=round(options.segmenter_latency_ms * 1000),
        ask_always=options.mode is TrackMode.FRAME,
    )


def _lens(path: Path | None, size_px: tuple[int, int] | None) -> LensModel | None:
    """Read a lens file; one of another image size raises CalibrationError."""
    if path is None:
        return None
    lens = load_lens(path)
    if size_px is not None and lens.size_px != size_px:
        raise CalibrationError(
            f"{path}: calibrated for {lens.size_px[0]}x{lens.size_px[1]} px, the camera has {size_px[0]}x{size_px[1]}.",
            "Calibrate the lens at the camera's own size.",
        )
    return lens
