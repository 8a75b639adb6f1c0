"""Record a running cell: its batches, triggers and frames from the bus into a recording, its states into tracks."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from motiondlo.bus.session import open_bus
from motiondlo.bus.subscriber import Subscriber
from motiondlo.config.cell import Cell
from motiondlo.config.loader import load_section
from motiondlo.errors import CalibrationError, ConfigError, MotionDLOError
from motiondlo.events.types import SensorGeometry
from motiondlo.messages.state import StateMessage
from motiondlo.recording.writer import RecordingWriter
from motiondlo.topics import EVENTS_BATCH, EVENTS_TRIGGER, FRAME, STATE
from motiondlo_services.cell_config import bus_section, check_configuration
from motiondlo_services.frame_capture.config import FrameCaptureConfig
from motiondlo_services.live_tracks import tracks_of

WAIT_S = 0.05
QUEUE = 512
"""Batches that may wait while the disk is slow: a second at 500 Hz."""


@dataclass
class Recorded:
    """What was recorded."""

    seconds: float
    events: int
    batches: int
    lost_batches: int
    frames: int
    frames_left_out: int
    states: int
    notes: tuple[str, ...] = ()


def record(
    config: Path,
    folder: Path,
    stopped: Callable[[float], bool],
    tracks: Path | None = None,
    start_limit_s: float = 30.0,
    silence_s: float = 3.0,
) -> Recorded:
    """Record until ``stopped(seconds recorded)``, or until no batch has come for ``silence_s``.

    tracks: write the cell's states there, in the recording's time. Raises MotionDLOError when no batch comes within
    ``start_limit_s``, RecordingError when the folder cannot be used, BusError when the cell does not run.
    """
    cell = check_configuration(config)
    notes = _notes(cell, config)
    states: list[StateMessage] = []
    client = bus_section(config).of_client(cell.cell.name, "event-ingest", "frame-capture", "fusion")
    with RecordingWriter(folder) as writer, open_bus(client, "recorder") as bus:
        batches = bus.subscriber(EVENTS_BATCH, queue=QUEUE)
        triggers = bus.subscriber(EVENTS_TRIGGER)
        frames = bus.subscriber(FRAME, queue=8)
        seen_states = None if tracks is None else bus.subscriber(STATE, queue=QUEUE)
        inputs: list[Subscriber[Any]] = [batches, triggers, frames, *([] if seen_states is None else [seen_states])]
        info = _camera_info(cell)
        writer.write_calibration(_homography(cell), cell.background(), info)
        newest_s = time.monotonic() + start_limit_s - silence_s
        while not stopped(writer.seconds):
            bus.wait(WAIT_S, *inputs)
            for told in triggers.drain():
                writer.add_triggers(told.triggers)
            for message in batches.drain():
                if not message.valid and not writer.batches:
                    continue  # sent ahead, to wake those who listen
                geometry = SensorGeometry(message.width_px, message.height_px)
                writer.add_batch(message.to_batch(batches.lost_before), geometry)
                info["event"] = {"width": geometry.width_px, "height": geometry.height_px}
                newest_s = time.monotonic()
            for frame in frames.drain():
                image = frame.image if frame.channels == "bgr" else np.ascontiguousarray(frame.image[:, :, ::-1])
                writer.add_frame(image, frame.t_us)
                info["rgb"] = {"width": image.shape[1], "height": image.shape[0]}
            if seen_states is not None:
                states += seen_states.drain()
            if time.monotonic() > newest_s + silence_s:
                break
        writer.write_calibration(None, None, info)
    if not writer.batches:
        raise MotionDLOError(f"No events came within {start_limit_s:g} s.", "See health/event-ingest; is the cell up?")
    if tracks is not None:
        begin_us = writer.t0_us
        shifted = [
            state.model_copy(update={"t_us": state.t_us - begin_us}) for state in states if state.t_us >= begin_us
        ]
        tracks_of(shifted).save(tracks)
    return replace(_figures(writer, len(states)), notes=notes)


def _figures(writer: RecordingWriter, states: int) -> Recorded:
    return Recorded(
        writer.seconds,
        writer.events,
        writer.batches,
        writer.lost_batches,
        writer.frames,
        writer.frames_left_out,
        states,
    )


def _notes(cell: Cell, config: Path) -> tuple[str, ...]:
    notes = []
    if not load_section(config, "frame_capture", FrameCaptureConfig).publish_all:
        notes.append("[frame_capture] publish_all is false: only the frames that the cell asked for were recorded")
    if cell.calibration.rgb_lens or cell.calibration.event_lens:
        notes.append("the recording has no place for the lenses: keep their files, and name them for its replay")
    return tuple(notes)


def _homography(cell: Cell) -> Any:
    try:
        return cell.event_from_rgb()
    except (ConfigError, CalibrationError):
        return None  # a cell without frames


def _camera_info(cell: Cell) -> dict[str, Any]:
    scale = cell.px_per_mm()
    return {} if scale is None else {"px_per_mm": scale}
