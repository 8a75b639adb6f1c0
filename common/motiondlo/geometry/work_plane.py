"""From event pixels to mm on the work plane: one scale, or a plane that the camera looks at from an angle.

The file is JSON: ``{"mm_from_event": [[...], [...], [...]]}``, a 3x3 homography from (undistorted) event
pixels to mm, or ``{"px_per_mm": 5.4}``.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import numpy as np
import numpy.typing as npt
from pydantic import BaseModel, ConfigDict, Field, ValidationError

from motiondlo.errors import CalibrationError
from motiondlo.geometry.homography import checked_homography, warp_points
from motiondlo.geometry.lens import LensModel

FloatArray = npt.NDArray[np.float64]

_Row = Annotated[tuple[float, ...], Field(min_length=3, max_length=3)]


class _PlaneFile(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)
    mm_from_event: Annotated[tuple[_Row, ...], Field(min_length=3, max_length=3)] | None = None
    px_per_mm: float | None = Field(default=None, gt=0.0, le=1000.0)


@dataclass(frozen=True)
class WorkPlane:
    """Where event pixels are on the work plane."""

    mm_from_event: FloatArray
    """(3, 3), last element 1."""
    event_lens: LensModel | None = None

    def mm(self, points_event: FloatArray) -> FloatArray:
        """(N, 2) event px -> (N, 2) mm."""
        ideal = points_event if self.event_lens is None else self.event_lens.undistorted(points_event)
        return warp_points(ideal, self.mm_from_event)

    def px_per_mm_over(self, width_px: int, height_px: int) -> tuple[float, float]:
        """Least and largest scale at the corners and the middle of the event image; inf where it is degenerate."""
        w, h = width_px - 1.0, height_px - 1.0
        places = np.array([[0.0, 0.0], [w, 0.0], [w, h], [0.0, h], [w / 2, h / 2]])
        with np.errstate(all="ignore"):
            dx, dy = (self.mm(places + step) - self.mm(places) for step in ([1.0, 0.0], [0.0, 1.0]))
            area = np.abs(dx[:, 0] * dy[:, 1] - dx[:, 1] * dy[:, 0])
            scale = 1.0 / np.sqrt(area)
        if not np.isfinite(scale).all():
            return np.inf, np.inf
        return float(scale.min()), float(scale.max())


def plane_of_scale(px_per_mm: float, event_lens: LensModel | None = None) -> WorkPlane:
    """A plane parallel to the image; its origin is the event image's top left pixel."""
    return WorkPlane(np.diag([1.0 / px_per_mm, 1.0 / px_per_mm, 1.0]), event_lens)


def load_work_plane(path: Path, event_lens: LensModel | None = None) -> WorkPlane:
    """Read a plane file. Raises CalibrationError naming the file and what is wrong with it."""
    try:
        file = _PlaneFile.model_validate_json(path.read_bytes())
    except OSError as error:
        raise CalibrationError(
            f"{path}: cannot be read ({error.strerror}).", "Give a plane file that exists."
        ) from error
    except ValidationError as error:
        first = error.errors()[0]
        where = ".".join(str(part) for part in first["loc"]) or "file"
        raise CalibrationError(f"{path}: {where}: {first['msg']}.", "Correct the plane file.") from error
    if (file.mm_from_event is None) == (file.px_per_mm is None):
        raise CalibrationError(f"{path}: needs either mm_from_event or px_per_mm.", "Correct the plane file.")
    if file.px_per_mm is not None:
        return plane_of_scale(file.px_per_mm, event_lens)
    return WorkPlane(checked_homography(np.array(file.mm_from_event), f"{path}: mm_from_event"), event_lens)
