"""The demonstration's picture: the fastest moment, over the RGB frame and over the events of the same time."""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np
import numpy.typing as npt

from motiondlo.client import extrapolate
from motiondlo.drawing.event_image import event_image
from motiondlo.drawing.overlay import DrawnDlo, overlay
from motiondlo.errors import RecordingError
from motiondlo.events.joining import join
from motiondlo.events.reader import open_events
from motiondlo.events.types import EventArray, empty_events
from motiondlo.messages.state import StateMessage
from motiondlo.recording.layout import FrameEntry, Image, Recording, read_image

_HALF_EXPOSURE_US = 2500
_WINDOW_US = 3000
_GAP_PX = 8


def fastest_frame(recording: Recording, states: Sequence[StateMessage]) -> tuple[FrameEntry, StateMessage]:
    """The frame at whose exposure the DLOs moved fastest, and the last state before its middle.

    Raises RecordingError when no state has a DLO, or the recording has no frame.
    """
    with_dlos = [state for state in states if state.dlos]
    if not with_dlos or not recording.frames:
        raise RecordingError("There is nothing to draw: no frame, or no DLO was tracked.", "See what doctor says.")
    times_us = np.array([state.t_us for state in with_dlos])

    def nearest(entry: FrameEntry) -> StateMessage:
        return with_dlos[max(0, int(np.searchsorted(times_us, entry.t_us + _HALF_EXPOSURE_US, side="right")) - 1)]

    def speed(state: StateMessage) -> float:
        # The mean over the visible nodes, so that a frame is chosen that shows the moving part.
        return max(float((np.hypot(*dlo.velocity_px_s.T) * dlo.visible).mean()) for dlo in state.dlos)

    entry = max(recording.frames, key=lambda entry: speed(nearest(entry)))
    return entry, nearest(entry)


def demo_picture(recording: Recording, states: Sequence[StateMessage]) -> Image:
    """(H, W, 3) uint8 BGR: the frame at the left, the events at the right, the same estimate over both.

    Over the frame, the estimate is carried on to the middle of the exposure.
    """
    entry, state = fastest_frame(recording, states)
    frame = read_image(entry.path)
    if frame is None:
        raise RecordingError(f"{entry.path}: not readable.", "Restore the file.")
    dlos = [
        DrawnDlo(dlo.id, dlo.nodes.astype(np.float64), dlo.sigma_px.astype(np.float64), dlo.visible)
        for dlo in state.dlos
    ]
    at_exposure = [
        DrawnDlo(dlo.id, dlo.nodes, dlo.sigma_px) for dlo in extrapolate(state, entry.t_us + _HALF_EXPOSURE_US)
    ]
    fastest = max(float(np.hypot(*dlo.velocity_px_s.T).max()) for dlo in state.dlos)
    px_per_mm = recording.camera_info.px_per_mm
    speed = f"{fastest / px_per_mm / 1000:.1f} m/s" if px_per_mm else f"{fastest / 1000:.1f} px/ms"
    events = event_image(_events_before(recording, state.t_us), open_events(recording.events_path).geometry)
    left = overlay(frame, at_exposure, recording.event_from_rgb(), caption=f"RGB frame, 5 ms exposure, {speed}")
    right = overlay(
        events, dlos, caption=f"events of the last {_WINDOW_US / 1000:.0f} ms, t = {state.t_us / 1000:.0f} ms"
    )
    return _beside(left, right)


def _events_before(recording: Recording, t_us: int) -> EventArray:
    pieces = [empty_events()]
    for batch in open_events(recording.events_path).batches():
        if batch.t0_us >= t_us:
            break
        if batch.t1_us > t_us - _WINDOW_US:
            pieces.append(batch.events)
    return join(pieces)


def _beside(left: npt.NDArray[np.uint8], right: npt.NDArray[np.uint8]) -> Image:
    height = min(left.shape[0], right.shape[0])
    panels = [
        cv2.resize(image, (round(image.shape[1] * height / image.shape[0]), height), interpolation=cv2.INTER_AREA)
        for image in (left, right)
    ]
    gap = np.full((height, _GAP_PX, 3), 255, np.uint8)
    return np.ascontiguousarray(np.hstack([panels[0], gap, panels[1]]), dtype=np.uint8)
