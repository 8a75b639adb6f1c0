"""Summarise a recording or a bare events file for a person: what is in it, and what is wrong with it."""

from __future__ import annotations

from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from motiondlo.errors import CalibrationError, RecordingError
from motiondlo.events.reader import EventFile, open_events
from motiondlo.events.trigger_monitor import RISING, TriggerMonitor
from motiondlo.events.types import SensorGeometry
from motiondlo.geometry.homography import warp_points
from motiondlo.recording.layout import Recording, open_recording

PEAK_WINDOW_US = 10_000
FRAME_TOLERANCE_US = 1000
"""A frame belongs to a rising edge if its time in the manifest is within this of it."""
GAP_US = 100_000
"""Silence of the whole sensor that is told: background noise alone gives an event every few microseconds."""
_TRIGGER_CHANNEL = 0


@dataclass(frozen=True)
class RecordingInfo:
    """Facts about a recording; those about frames are None for a bare events file."""

    path: str
    format: str
    geometry: str
    duration_s: float
    """From time 0, or from the first event if that is later than 1 s, to the last event."""
    events: int
    events_per_s: float
    peak_events_per_s: float
    """Over windows of 10 ms."""
    on_share: float
    triggers: int
    trigger_period_ms: float
    triggers_missed: int
    gaps: int
    """Stretches without any event for more than 100 ms."""
    longest_gap_ms: float
    damage: dict[str, int] = field(default_factory=dict)
    clock_marks: dict[str, int] = field(default_factory=dict)
    frames: int | None = None
    frames_matched: int | None = None
    """Frames whose time is that of a rising trigger edge."""
    frames_without_trigger: int | None = None
    triggers_without_frame: int | None = None
    frame_rejects: dict[str, int] | None = None
    homography: str | None = None
    """``ok``, ``none``, or what is wrong with it."""
    ground_truth: bool | None = None
    background: bool | None = None

    def as_dict(self) -> dict[str, Any]:
        """Plain values by name, without those that do not apply."""
        return {name: value for name, value in asdict(self).items() if value is not None}


def summarise(path: Path) -> RecordingInfo:
    """Read all of a recording's events once (``path``: its folder, or a ``.raw`` file).

    Raises RecordingError when there is no such recording, or its events are in no supported format.
    """
    if not path.exists():
        raise RecordingError(f"{path}: does not exist.", "Give the folder of a recording, or a .raw file.")
    recording = open_recording(path) if path.is_dir() else None
    events_path = path if recording is None else recording.events_path
    geometry = None
    if recording is not None and recording.camera_info.event is not None:
        size = recording.camera_info.event
        geometry = SensorGeometry(size.width, size.height)
    source = open_events(events_path, geometry)
    scan = _scan(source)
    facts: dict[str, Any] = {
        "path": str(path),
        "format": source.format.value,
        "geometry": f"{source.geometry.width_px}x{source.geometry.height_px}",
        "damage": source.damage,
        "clock_marks": source.marks,
        **scan.facts(),
    }
    if recording is not None:
        facts |= _frame_facts(recording, scan.rising_us)
        facts["homography"] = _homography_state(recording)
        facts["ground_truth"] = recording.ground_truth_path.is_file()
        facts["background"] = recording.background() is not None
    return RecordingInfo(**facts)


class _Scan:
    """Figures of one pass over the events."""

    def __init__(self) -> None:
        self.events = 0
        self.on = 0
        self.last_us = -1
        self.start_us = -1
        self.peak = 0
        self.gaps = 0
        self.longest_gap_us = 0
        self.rising_us: list[int] = []
        self.monitor = TriggerMonitor(_TRIGGER_CHANNEL)

    def gap(self, silence_us: int) -> None:
        """Count a silence, if it is one."""
        if silence_us > GAP_US:
            self.gaps += 1
        self.longest_gap_us = max(self.longest_gap_us, silence_us)

    def facts(self) -> dict[str, Any]:
        """Fields of RecordingInfo."""
        duration_s = max(self.last_us - self.start_us, 0) * 1e-6 if self.events else 0.0
        return {
            "duration_s": round(duration_s, 6),
            "events": self.events,
            "events_per_s": round(self.events / duration_s) if duration_s else 0.0,
            "peak_events_per_s": self.peak * 1e6 / PEAK_WINDOW_US,
            "on_share": round(self.on / self.events, 4) if self.events else 0.0,
            "triggers": self.monitor.triggers,
            "trigger_period_ms": self.monitor.period_us / 1000,
            "triggers_missed": self.monitor.missed,
            "gaps": self.gaps,
            "longest_gap_ms": self.longest_gap_us / 1000,
        }


def _scan(source: EventFile) -> _Scan:
    scan = _Scan()
    for batch in source.batches(PEAK_WINDOW_US):
        if scan.start_us < 0:
            scan.start_us = batch.t0_us
        scan.monitor.push(batch.triggers)
        rising = (batch.triggers["edge"] == RISING) & (batch.triggers["channel"] == _TRIGGER_CHANNEL)
        scan.rising_us += batch.triggers["t"][rising].tolist()
        n = len(batch.events)
        if not n:
            continue
        times_us = batch.events["t"]
        if scan.last_us >= 0:
            scan.gap(int(times_us[0]) - scan.last_us)
        elif scan.start_us > 0:
            scan.start_us = int(times_us[0])
        scan.longest_gap_us = max(scan.longest_gap_us, int(np.diff(times_us).max(initial=0)))
        scan.last_us = int(times_us[-1])
        scan.events += n
        scan.on += int(np.count_nonzero(batch.events["p"]))
        scan.peak = max(scan.peak, n)
    return scan


def _frame_facts(recording: Recording, rising_us: list[int]) -> dict[str, Any]:
    edges = np.array(rising_us, np.int64)
    taken: set[int] = set()
    for frame in recording.frames:
        if len(edges):
            nearest = int(np.abs(edges - frame.t_us).argmin())
            if abs(int(edges[nearest]) - frame.t_us) <= FRAME_TOLERANCE_US:
                taken.add(nearest)
    return {
        "frames": len(recording.frames),
        "frames_matched": len(taken),
        "frames_without_trigger": len(recording.frames) - len(taken),
        "triggers_without_frame": len(edges) - len(taken),
        "frame_rejects": {reason.value: n for reason, n in recording.rejects.items()},
    }


def _homography_state(recording: Recording) -> str:
    """Present, regular, and it maps the middle of the RGB image into the event sensor's image or near it."""
    if not (recording.path / "homography" / "rgb_to_event_H.npy").is_file():
        return "none"
    try:
        event_from_rgb = recording.event_from_rgb()
    except CalibrationError as error:
        return error.what
    info = recording.camera_info
    if info.rgb is not None and info.event is not None:
        middle = np.array([[info.rgb.width / 2, info.rgb.height / 2]])
        x, y = warp_points(middle, event_from_rgb)[0]
        if not (0 <= x <= info.event.width and 0 <= y <= info.event.height):
            return f"implausible: the middle of the RGB image falls on ({x:.0f}, {y:.0f}) px of the event camera"
    return "ok"
