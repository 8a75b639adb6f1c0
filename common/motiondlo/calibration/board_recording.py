"""Point pairs from a recording of a board that both cameras see while it moves or blinks."""

from __future__ import annotations

import cv2
import numpy as np

from motiondlo.calibration.boards import Board, find_corners, join_pairs, pair_corners
from motiondlo.calibration.event_picture import EventPicture
from motiondlo.calibration.point_pairs import PointPairs
from motiondlo.events.reader import open_events
from motiondlo.events.types import EventBatch
from motiondlo.recording.layout import Recording, read_image

_BATCH_US = 500


def board_pairs(recording: Recording, board: Board, most_pictures: int = 20) -> PointPairs:
    """Corners of the board in frames and, at the middle of each exposure, in the events.

    The board lies on the work plane. Raises RecordingError for an unreadable recording, CalibrationError when the board
    is never seen by both cameras at one instant.
    """
    size = recording.camera_info.event
    events = open_events(recording.events_path)
    geometry = events.geometry
    picture = EventPicture(geometry)
    frames = list(recording.frames[:: max(1, len(recording.frames) // most_pictures)])
    if size is not None and (size.width, size.height) != (geometry.width_px, geometry.height_px):
        frames = []
    parts = []
    open_frame, middle_us = None, 0
    for batch in events.batches(_BATCH_US):
        while open_frame is None and frames and frames[0].t_us < batch.t1_us:
            open_frame = frames.pop(0)
            middle_us = open_frame.t_us + _half_exposure_us(batch, open_frame.t_us)
        picture.add(batch.events)
        if open_frame is None or batch.t1_us < middle_us:
            continue
        image = read_image(open_frame.path)
        open_frame = None
        if image is None:
            continue
        rgb = find_corners(np.asarray(cv2.cvtColor(image, cv2.COLOR_BGR2GRAY), dtype=np.uint8), board)
        seen = None if rgb is None else find_corners(picture.at(batch.t1_us), board)
        if rgb is not None and seen is not None:
            p, q = pair_corners(rgb, seen, board)
            if len(p) >= 4:
                parts.append((p, q))
    return join_pairs(parts, str(recording.path))


def _half_exposure_us(batch: EventBatch, start_us: int) -> int:
    """Half the time to the falling edge of the trigger, where the batch has it; half of 5 ms otherwise."""
    triggers = batch.triggers
    falling = triggers["t"][(triggers["edge"] == 0) & (triggers["t"] > start_us)]
    return int(falling[0] - start_us) // 2 if len(falling) else 2500
