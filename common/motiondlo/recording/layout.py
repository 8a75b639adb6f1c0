"""Open a recording: events, frames with trigger times, homography, camera information, background plate.

```
RECORDING/
  events.raw                       Prophesee RAW (EVT3, EVT2, EVT2.1) with external triggers
  frames/frame_000001.jpg ...      RGB
  manifest.json                    {"frame_000001.jpg": trigger_us, ...}
  homography/rgb_to_event_H.npy    3x3 float64
  camera_info.json                 optional
  background.jpg                   optional: the empty board
  ground_truth.npz                 optional
```
"""

from __future__ import annotations

import json
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt
from pydantic import BaseModel, ConfigDict, Field, ValidationError

from motiondlo.errors import RecordingError
from motiondlo.geometry.homography import FloatArray, load_homography
from motiondlo.rejects import RejectReason

Image = npt.NDArray[np.uint8]
"""(H, W, 3) uint8, BGR."""

HOMOGRAPHY_FILE = Path("homography") / "rgb_to_event_H.npy"

_MAX_JSON_BYTES = 64 << 20
_MAX_TIME_US = (1 << 62) - 1


class ImageSize(BaseModel):
    """Width and height of an image, px."""

    model_config = ConfigDict(frozen=True)
    width: int = Field(gt=0, le=16384)
    height: int = Field(gt=0, le=16384)


class CameraInfo(BaseModel):
    """``camera_info.json``: everything in it is optional, unknown keys are ignored."""

    model_config = ConfigDict(frozen=True)
    event: ImageSize | None = None
    rgb: ImageSize | None = None
    px_per_mm: float | None = Field(default=None, gt=0, description="event px per mm on the work plane")
    diameters_mm: tuple[float, ...] = ()


@dataclass(frozen=True)
class FrameEntry:
    """One frame of the manifest whose file exists."""

    name: str
    path: Path
    t_us: int
    """Start of the exposure: the rising edge of its trigger, event clock."""


@dataclass(frozen=True)
class Recording:
    """A recording whose files were found; images and matrices are read when asked for."""

    path: Path
    events_path: Path
    frames: tuple[FrameEntry, ...] = ()
    """Sorted by time."""
    camera_info: CameraInfo = field(default_factory=CameraInfo)
    rejects: dict[RejectReason, int] = field(default_factory=dict)
    """What the manifest promises and the disk does not have, counted per reason."""

    @property
    def name(self) -> str:
        """The folder's name."""
        return self.path.resolve().name

    @property
    def ground_truth_path(self) -> Path:
        """Where the ground truth is, if there is one."""
        return self.path / "ground_truth.npz"

    def event_from_rgb(self) -> FloatArray:
        """The 3x3 homography from RGB to event pixels. Raises CalibrationError when absent, misshapen or singular."""
        return load_homography(self.path / HOMOGRAPHY_FILE)

    def background(self) -> Image | None:
        """(H, W, 3) uint8 BGR picture of the empty board, or None when there is none that can be read."""
        path = self.path / "background.jpg"
        return read_image(path) if path.is_file() else None


def read_image(path: Path) -> Image | None:
    """Decode an image file to (H, W, 3) uint8 BGR; None when it is missing, cut short, or no image.

    A JPEG without its end marker was cut short: decoders would fill the rest with grey, so it is refused.
    """
    try:
        data = path.read_bytes()
    except OSError:
        return None
    if data[:2] == b"\xff\xd8" and b"\xff\xd9" not in data[-64:]:
        return None
    if not data:
        return None
    image = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR)
    return None if image is None else np.asarray(image, dtype=np.uint8)


def open_recording(path: Path) -> Recording:
    """Find the parts of a recording.

    Missing frames and damaged manifest entries are counted, never fatal (the event branch goes on without them).
    Raises RecordingError when the folder or its events file does not exist.
    """
    if not path.is_dir():
        raise RecordingError(f"{path}: no such folder.", "Give the folder that holds events.raw.")
    events_path = path / "events.raw"
    if not events_path.is_file():
        raise RecordingError(f"{path}: has no events.raw.", "Give the folder that holds events.raw.")
    rejects: dict[RejectReason, int] = {}
    frames = _read_manifest(path, rejects)
    return Recording(path, events_path, frames, _read_camera_info(path), rejects)


def _read_manifest(path: Path, rejects: dict[RejectReason, int]) -> tuple[FrameEntry, ...]:
    manifest_path = path / "manifest.json"
    folder = path / "frames"
    on_disk = {p.name for p in folder.iterdir() if p.is_file()} if folder.is_dir() else set()
    if not manifest_path.is_file():
        _count(rejects, RejectReason.FRAME_WITHOUT_TRIGGER, len(on_disk))
        return ()
    manifest = _read_json_object(manifest_path)
    entries = []
    for name, t_us in manifest.items():
        if (
            not isinstance(t_us, int)
            or isinstance(t_us, bool)
            or not 0 <= t_us <= _MAX_TIME_US
            or Path(name).name != name
        ):
            _count(rejects, RejectReason.FRAME_WITHOUT_TRIGGER, 1)
        elif name not in on_disk:
            _count(rejects, RejectReason.FRAME_MISSING, 1)
        else:
            entries.append(FrameEntry(name, folder / name, t_us))
    _count(rejects, RejectReason.FRAME_WITHOUT_TRIGGER, len(on_disk - manifest.keys()))
    return tuple(sorted(entries, key=lambda entry: (entry.t_us, entry.name)))


def _read_camera_info(path: Path) -> CameraInfo:
    info_path = path / "camera_info.json"
    if not info_path.is_file():
        return CameraInfo()
    try:
        return CameraInfo.model_validate(_read_json_object(info_path))
    except ValidationError as error:
        first = error.errors()[0]
        where = ".".join(str(part) for part in first["loc"])
        raise RecordingError(f"{info_path}: {where}: {first['msg']}.", "Correct the file or remove it.") from error


def _read_json_object(path: Path) -> dict[str, Any]:
    try:
        with path.open("rb") as file:
            text = file.read(_MAX_JSON_BYTES + 1)
        if len(text) > _MAX_JSON_BYTES:
            raise ValueError(f"it has more than {_MAX_JSON_BYTES >> 20} MiB")
        data = json.loads(text.decode("utf-8"))
    except (OSError, ValueError, RecursionError) as error:
        raise RecordingError(f"{path}: not readable as JSON ({error}).", "Correct the file or remove it.") from error
    if not isinstance(data, dict):
        raise RecordingError(f"{path}: holds no JSON object.", "Correct the file or remove it.")
    return data


def _count(rejects: dict[RejectReason, int], reason: RejectReason, n: int) -> None:
    if n:
        rejects[reason] = rejects.get(reason, 0) + n
