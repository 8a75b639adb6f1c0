"""Sections of a cell's configuration that several daemons read: the cell itself, calibration, replay."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
import numpy.typing as npt
from pydantic import BaseModel, ConfigDict, Field

from motiondlo.config.loader import load_section
from motiondlo.errors import CalibrationError, ConfigError
from motiondlo.events.types import SensorGeometry
from motiondlo.geometry.camera_map import CameraMap
from motiondlo.geometry.homography import FloatArray, load_homography
from motiondlo.geometry.lens import LensModel, load_lens
from motiondlo.geometry.work_plane import WorkPlane, load_work_plane, plane_of_scale
from motiondlo.recording.layout import Recording, open_recording, read_image


class CellSection(BaseModel):
    """``[cell]``: what this cell is called and how its daemons are scheduled."""

    model_config = ConfigDict(frozen=True, extra="forbid", strict=True)

    name: str = Field(
        default="cell", pattern=r"^[a-z0-9][a-z0-9_-]{0,31}$", description="part of every topic: motiondlo/<name>/..."
    )
    realtime: bool = Field(default=True, description="use SCHED_FIFO and locked memory where the machine permits it")
    standby: bool = Field(
        default=True,
        description="motiondlo run keeps a second, loaded process of each daemon of the event path, which takes over",
    )
    state_folder: str = Field(
        default="",
        description="what commands change (regions) is kept here; empty: systemd's StateDirectory, or not kept",
    )


class CalibrationSection(BaseModel):
    """``[calibration]``: how the cameras see the work plane. In a replay the recording's own files are the default."""

    model_config = ConfigDict(frozen=True, extra="forbid", strict=True)

    event_from_rgb: str = Field(default="", description="3x3 homography from RGB to event pixels (.npy)")
    rgb_lens: str = Field(default="", description="lens distortion of the RGB camera (.json); empty: none")
    event_lens: str = Field(default="", description="lens distortion of the event camera (.json); empty: none")
    work_plane: str = Field(default="", description="plane file: mm from event pixels (.json); instead of px_per_mm")
    background: str = Field(default="", description="RGB picture of the empty board")
    px_per_mm: float = Field(
        default=0.0, ge=0.0, le=1000.0, description="event px per mm on the work plane; 0: unknown"
    )
    sensor_width_px: int = Field(default=1280, ge=16, le=8192, description="width of the event sensor")
    sensor_height_px: int = Field(default=720, ge=16, le=8192, description="height of the event sensor")


class ReplaySection(BaseModel):
    """``[replay]``: play a recording instead of cameras."""

    model_config = ConfigDict(frozen=True, extra="forbid", strict=True)

    recording: str = Field(default="", description="folder of the recording; empty: a live cell")
    speed: float = Field(default=1.0, ge=0.0, le=100.0, description="1 is real time; 0 as fast as possible")
    wait_for_tracker_s: float = Field(
        default=60.0,
        ge=0.0,
        le=600.0,
        description="hold the first event until the tracker knows its DLOs, at most this long",
    )
    segmenter_latency_ms: float = Field(
        default=1000.0,
        ge=0.0,
        le=60000.0,
        description="event time from the request of a segmentation to its use, as in motiondlo track; 0: at once",
    )


@dataclass(frozen=True)
class Cell:
    """The shared sections of one configuration file, with paths resolved against the file's folder."""

    path: Path
    cell: CellSection
    calibration: CalibrationSection
    replay: ReplaySection

    @property
    def geometry(self) -> SensorGeometry:
        """Size of the event sensor."""
        return SensorGeometry(self.calibration.sensor_width_px, self.calibration.sensor_height_px)

    def resolve(self, name: str) -> Path:
        """A path of the configuration; relative ones start at the configuration file's folder."""
        return (self.path.parent / Path(name).expanduser()).resolve()

    @property
    def state_folder(self) -> Path | None:
        """Where daemons keep what commands change; None where the configuration names no folder."""
        return self.resolve(self.cell.state_folder) if self.cell.state_folder else None

    def recording(self) -> Recording | None:
        """The recording to replay, or None for a live cell. Raises RecordingError when it cannot be opened."""
        return self._recording

    @cached_property
    def _recording(self) -> Recording | None:
        return open_recording(self.resolve(self.replay.recording)) if self.replay.recording else None

    def event_from_rgb(self) -> FloatArray:
        """The cell's homography. Raises CalibrationError or ConfigError when there is none that can be used."""
        if self.calibration.event_from_rgb:
            return load_homography(self.resolve(self.calibration.event_from_rgb))
        recording = self.recording()
        if recording is None:
            raise ConfigError(
                f"{self.path}: [calibration] event_from_rgb is empty.", "Give the homography of the cell's cameras."
            )
        return recording.event_from_rgb()

    def event_map(self) -> FloatArray | CameraMap:
        """How RGB pixels become event pixels: the homography, between the lenses if their files are given.

        Raises CalibrationError or ConfigError as :meth:`event_from_rgb`, and for an unusable lens file.
        """
        rgb, event = self.rgb_lens(), self.event_lens()
        matrix = self.event_from_rgb()
        return matrix if rgb is None and event is None else CameraMap(matrix, rgb, event)

    def rgb_lens(self) -> LensModel | None:
        """Lens of the RGB camera, if a file is given. Raises CalibrationError."""
        return load_lens(self.resolve(self.calibration.rgb_lens)) if self.calibration.rgb_lens else None

    def event_lens(self) -> LensModel | None:
        """Lens of the event camera, if a file is given. Raises CalibrationError."""
        return load_lens(self.resolve(self.calibration.event_lens)) if self.calibration.event_lens else None

    def work_plane(self) -> WorkPlane | None:
        """How event pixels become mm: the plane file, or the scale; None when neither is known.

        Raises CalibrationError for an unusable file, ConfigError when both are given.
        """
        if self.calibration.work_plane:
            if self.calibration.px_per_mm > 0:
                raise ConfigError(
                    f"{self.path}: [calibration] has both work_plane and px_per_mm.",
                    "Remove px_per_mm: the file has it.",
                )
            return load_work_plane(self.resolve(self.calibration.work_plane), self.event_lens())
        scale = self.px_per_mm()
        return None if scale is None else plane_of_scale(scale, self.event_lens())

    def background(self) -> npt.NDArray[np.uint8] | None:
        """The picture of the empty board, or None. Raises CalibrationError when a named one is unreadable."""
        if self.calibration.background:
            path = self.resolve(self.calibration.background)
            image = read_image(path)
            if image is None:
                raise CalibrationError(f"{path}: no readable picture.", "Take a picture of the empty board again.")
            return image
        recording = self.recording()
        return None if recording is None else recording.background()

    def px_per_mm(self) -> float | None:
        """Scale of the work plane, if it is known."""
        if self.calibration.px_per_mm > 0:
            return self.calibration.px_per_mm
        recording = self.recording()
        return None if recording is None else recording.camera_info.px_per_mm


def load_cell(path: Path) -> Cell:
    """Read the shared sections. Raises ConfigError naming file, field, value and bound."""
    return Cell(
        path=path.resolve(),
        cell=load_section(path, "cell", CellSection),
        calibration=load_section(path, "calibration", CalibrationSection),
        replay=load_section(path, "replay", ReplaySection),
    )
