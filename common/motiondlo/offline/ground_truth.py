"""Ground truth of a recording: ``ground_truth.npz``.

K DLOs, T times, N nodes; node 0 is in the gripper. Visibility 0 is visible, any other value a reason why not.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from motiondlo.errors import RecordingError
from motiondlo.offline.archive import read_archive

_REMEDY = "Evaluate a recording that has the documented ground truth."


@dataclass(frozen=True)
class GroundTruth:
    """True centrelines of all DLOs over a recording."""

    times_us: npt.NDArray[np.int64]
    """(T,) event clock, increasing."""
    nodes: npt.NDArray[np.float32]
    """(K, T, N, 2) event px, equidistant along the DLO; also where it is hidden or outside the image."""
    visibility: npt.NDArray[np.uint8]
    """(K, T, N) 0 visible, 1 outside the image, 2 under the gripper, 3 under a cable, 4 under a plate."""
    moving: npt.NDArray[np.bool_]
    """(K, T)."""
    moved: npt.NDArray[np.bool_]
    """(K,) whether the DLO moves at some time."""
    speed_mm_s: npt.NDArray[np.float32]
    """(K, T) speed of the fastest node in the image."""
    px_per_mm: float
    names: tuple[str, ...]
    """(K,)."""
    width_px: int = 1280
    height_px: int = 720

    @property
    def count(self) -> int:
        """K, the number of DLOs."""
        return len(self.names)

    def nearest_index(self, t_us: npt.NDArray[Any]) -> npt.NDArray[np.intp]:
        """Indices of the true times nearest to ``t_us`` (R,), for what cannot be interpolated. Returns (R,)."""
        right = np.clip(np.searchsorted(self.times_us, t_us), 1, len(self.times_us) - 1)
        left = right - 1
        return np.where(t_us - self.times_us[left] <= self.times_us[right] - t_us, left, right)

    def nodes_at(self, dlo: int, t_us: npt.NDArray[Any]) -> npt.NDArray[np.float64]:
        """Nodes of one DLO, interpolated at ``t_us`` (R,) and held past both ends. Returns (R, N, 2) event px."""
        right = np.clip(np.searchsorted(self.times_us, t_us), 1, len(self.times_us) - 1)
        t0, t1 = self.times_us[right - 1], self.times_us[right]
        u = np.clip((t_us - t0) / (t1 - t0), 0.0, 1.0)[:, None, None]
        truth = self.nodes[dlo]
        return np.asarray(truth[right - 1] * (1.0 - u) + truth[right] * u, dtype=np.float64)

    def judged(self, dlo: int) -> npt.NDArray[np.bool_]:
        """(T,) when a DLO is judged: while it moves if it ever moves, otherwise while anything moves."""
        moving = self.moving[dlo] if self.moved[dlo] else self.moving.any(axis=0)
        return np.asarray(moving, dtype=np.bool_)


def load_ground_truth(path: Path) -> GroundTruth:
    """Read ``ground_truth.npz``. Raises RecordingError naming the file and the array that is absent or wrong."""
    if not path.is_file():
        raise RecordingError(f"{path}: no such file.", "Evaluation needs a recording with ground_truth.npz.")
    arrays = read_archive(path, RecordingError, _REMEDY)
    needed = ("times_us", "nodes", "visibility", "moving", "moved", "speed_mm_s", "px_per_mm", "names")
    for key in needed:
        if key not in arrays:
            raise RecordingError(f"{path}: has no array {key}.", _REMEDY)
    nodes = arrays["nodes"]
    if nodes.ndim != 4 or nodes.shape[3] != 2 or nodes.shape[1] < 2 or nodes.shape[2] < 2:
        raise RecordingError(f"{path}: nodes is {nodes.shape}, expected (K, T, N, 2).", _REMEDY)
    k, t, n = nodes.shape[:3]
    shapes = {
        "times_us": (t,),
        "visibility": (k, t, n),
        "moving": (k, t),
        "moved": (k,),
        "speed_mm_s": (k, t),
        "names": (k,),
        "px_per_mm": (),
    }
    for key, shape in shapes.items():
        if arrays[key].shape != shape:
            raise RecordingError(f"{path}: {key} is {arrays[key].shape}, expected {shape}.", _REMEDY)
    px_per_mm = float(arrays["px_per_mm"])
    if not np.isfinite(nodes).all() or not px_per_mm > 0:
        raise RecordingError(f"{path}: nodes or px_per_mm hold values that cannot be.", _REMEDY)
    if (np.diff(arrays["times_us"]) <= 0).any():
        raise RecordingError(f"{path}: times_us does not increase.", _REMEDY)
    return GroundTruth(
        times_us=arrays["times_us"].astype(np.int64),
        nodes=nodes.astype(np.float32),
        visibility=arrays["visibility"].astype(np.uint8),
        moving=arrays["moving"].astype(np.bool_),
        moved=arrays["moved"].astype(np.bool_),
        speed_mm_s=arrays["speed_mm_s"].astype(np.float32),
        px_per_mm=px_per_mm,
        names=tuple(str(name) for name in arrays["names"]),
        width_px=int(arrays.get("width", 1280)),
        height_px=int(arrays.get("height", 720)),
    )
