"""Write a recording piece by piece, as it happens: events, frames, manifest, in the layout that every tool reads.

Times are shifted so that the recording begins at 0. The manifest is renewed now and then, so that a recording whose
writer was killed can be opened up to there.
"""

from __future__ import annotations

import json
import queue
import threading
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from motiondlo.errors import RecordingError
from motiondlo.events.joining import join
from motiondlo.events.types import EventBatch, SensorGeometry, TriggerArray, empty_triggers
from motiondlo.events.writer import Evt3Writer
from motiondlo.geometry.homography import FloatArray
from motiondlo.recording.layout import HOMOGRAPHY_FILE, Image

JPEG_QUALITY = 95
FRAMES_WAITING = 16
"""Frames that wait to be encoded; of 2592x1944 they hold 240 MB."""
_MANIFEST_EVERY = 20


class RecordingWriter:
    """A new recording in ``folder``. One thread calls it; a second one encodes the frames. A context manager."""

    def __init__(self, folder: Path) -> None:
        """Raises RecordingError when the folder holds something already, or cannot be made."""
        self._folder = folder
        try:
            if folder.exists() and any(folder.iterdir()):
                raise RecordingError(f"{folder}: is not empty.", "Choose another folder.")
            (folder / "frames").mkdir(parents=True)
        except OSError as error:
            raise RecordingError(f"{folder}: cannot be made ({error.strerror}).", "Choose another folder.") from error
        self._events: Evt3Writer | None = None
        self._t0_us = self._until_us = -1
        self._triggers: list[TriggerArray] = []
        self._manifest: dict[str, int] = {}
        self._frames: queue.Queue[tuple[Image, int] | None] = queue.Queue(FRAMES_WAITING)
        self._problem: OSError | None = None
        self._saver = threading.Thread(target=self._save_frames, name="frame saver", daemon=True)
        self._saver.start()
        self.events = 0
        self.batches = 0
        self.lost_batches = 0
        """Known to be missing in what was written."""
        self.repeated_batches = 0
        """Not written, because the recording had their time already."""
        self.frames_left_out = 0
        """From before the recording's start, or more than could be encoded in time."""

    @property
    def t0_us(self) -> int:
        """Event time of the cell at which the recording begins; -1 before the first batch."""
        return self._t0_us

    @property
    def seconds(self) -> float:
        """Length so far."""
        return max(self._until_us - self._t0_us, 0) * 1e-6

    @property
    def frames(self) -> int:
        """Frames on the disk."""
        return len(self._manifest)

    def write_calibration(
        self, event_from_rgb: FloatArray | None, background: Image | None, info: dict[str, Any]
    ) -> None:
        """The homography, the picture of the empty board, ``camera_info.json``. Raises RecordingError."""
        try:
            if event_from_rgb is not None:
                (self._folder / HOMOGRAPHY_FILE).parent.mkdir(exist_ok=True)
                np.save(self._folder / HOMOGRAPHY_FILE, event_from_rgb)
            if background is not None:
                (self._folder / "background.jpg").write_bytes(_jpeg(background))
            _write_json(self._folder / "camera_info.json", info)
        except OSError as error:
            raise self._failed(error) from error

    def add_triggers(self, triggers: TriggerArray) -> None:
        """Triggers (K,) told apart from batches: they are used where the batch that held them is missing."""
        self._triggers.append(triggers)
        del self._triggers[:-256]

    def add_batch(self, batch: EventBatch, geometry: SensorGeometry) -> None:
        """The next batch. Raises RecordingError when it cannot be written."""
        if self._problem is not None:
            raise self._failed(self._problem)
        if self._events is None:
            self._events = Evt3Writer(self._folder / "events.raw", geometry)
            self._t0_us = self._until_us = batch.t0_us
        elif batch.t0_us < self._until_us:
            self.repeated_batches += 1
            return
        else:
            self.lost_batches += batch.lost_before
        events = batch.events.copy()
        events["t"] -= self._t0_us
        triggers = join([self._told_between(self._until_us, batch.t0_us), batch.triggers]).copy()
        triggers["t"] -= self._t0_us
        try:
            self._events.write(events, triggers)
        except OSError as error:
            raise self._failed(error) from error
        self._until_us = batch.t1_us
        self.batches += 1
        self.events += len(events)

    def add_frame(self, image: npt.NDArray[np.uint8], t_us: int) -> None:
        """A frame (H, W, 3) uint8 BGR whose trigger was at ``t_us`` of the cell; encoded later. The image is kept."""
        if self._t0_us < 0 or t_us < self._t0_us:
            self.frames_left_out += 1
            return
        try:
            self._frames.put_nowait((image, t_us - self._t0_us))
        except queue.Full:
            self.frames_left_out += 1

    def close(self) -> None:
        """Encode what waits, finish the files. Raises RecordingError."""
        if self._saver.is_alive():
            self._frames.put(None)
            self._saver.join()
        try:
            if self._events is not None:
                self._events.close()
            self._write_manifest()
        except OSError as error:
            raise self._failed(error) from error
        if self._problem is not None:
            raise self._failed(self._problem)

    def __enter__(self) -> RecordingWriter:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _told_between(self, from_us: int, to_us: int) -> TriggerArray:
        """(K,) triggers told apart, of a span without batches."""
        told = join([empty_triggers(), *(self._triggers if to_us > from_us else [])])
        return told[(told["t"] >= from_us) & (told["t"] < to_us)].copy()

    def _save_frames(self) -> None:
        while (item := self._frames.get()) is not None:
            if self._problem is not None:
                continue
            image, t_us = item
            name = f"frame_{len(self._manifest) + 1:06d}.jpg"
            try:
                (self._folder / "frames" / name).write_bytes(_jpeg(image))
                self._manifest[name] = t_us
                if len(self._manifest) % _MANIFEST_EVERY == 1:
                    self._write_manifest()
            except OSError as error:
                self._problem = error

    def _write_manifest(self) -> None:
        _write_json(self._folder / "manifest.json", self._manifest)

    def _failed(self, error: OSError) -> RecordingError:
        return RecordingError(f"{self._folder}: cannot be written ({error.strerror}).", "Is the disk full?")


def _jpeg(image: Image) -> bytes:
    data: npt.NDArray[np.uint8] = cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY])[1]
    return data.tobytes()


def _write_json(path: Path, document: dict[str, Any]) -> None:
    half = path.with_suffix(".new")
    half.write_text(json.dumps(document, indent=1) + "\n", encoding="utf-8")
    half.replace(path)
