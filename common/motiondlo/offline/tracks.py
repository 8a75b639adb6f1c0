"""The result of a tracker over a recording: ``tracks.npz``.

One row is one DLO at one time; several rows may share a time. Rows are sorted by time. A row for time t uses nothing
that would have arrived after t.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from motiondlo.errors import MotionDLOError
from motiondlo.geometry.curve import resample
from motiondlo.geometry.work_plane import WorkPlane
from motiondlo.offline.archive import read_archive

_SOURCE_DTYPE = np.dtype("U9")
_FARTHEST_PX = 1e6
_FIELDS = (
    "times_us (T,), nodes (T, M, 2); optional ids, valid, source, confidence (T,), sigma_px, sigma_tangent_px (T, M)"
)


class TracksError(MotionDLOError):
    """A tracks file is absent, unreadable or does not have the documented arrays."""


@dataclass(frozen=True)
class Tracks:
    """Estimates, sorted by time; T rows of M nodes."""

    times_us: npt.NDArray[np.int64]
    """(T,) event clock, the time that the estimate is for."""
    nodes: npt.NDArray[np.float32]
    """(T, M, 2) event px."""
    ids: npt.NDArray[np.int64]
    """(T,) which DLO the row is."""
    valid: npt.NDArray[np.bool_]
    """(T,) False where the row is no estimate; rows with nodes that are not finite are never valid."""
    sigma_px: npt.NDArray[np.float32]
    """(T, M) standard deviation normal to the curve, event px; NaN where the tracker gives none."""
    source: npt.NDArray[np.str_]
    """(T,) what the estimate rests on: "event", "frame", "predicted", or "" where unknown."""
    sigma_tangent_px: npt.NDArray[np.float32]
    """(T, M) standard deviation along the curve, event px; NaN where the tracker gives none."""
    confidence: npt.NDArray[np.float32]
    """(T,) 0..1; NaN where the tracker gives none."""

    def __len__(self) -> int:
        """Number of rows."""
        return len(self.times_us)

    def estimates_of(self, track_id: int) -> npt.NDArray[np.intp]:
        """Indices of the valid rows of one id, in time order."""
        return np.flatnonzero((self.ids == track_id) & self.valid)

    def known_ids(self) -> tuple[int, ...]:
        """Ids that have at least one valid row, ascending."""
        return tuple(int(i) for i in np.unique(self.ids[self.valid]))

    def save(self, path: Path, work_plane: WorkPlane | None = None) -> None:
        """Write ``path`` (compressed ``.npz``), with ``nodes_mm`` (T, M, 2) where the work plane is known.

        Raises TracksError when it cannot be written.
        """
        more: dict[str, Any] = {} if work_plane is None else {"nodes_mm": self.nodes_mm(work_plane)}
        try:
            with path.open("wb") as file:
                np.savez_compressed(
                    file,
                    times_us=self.times_us,
                    nodes=self.nodes,
                    ids=self.ids,
                    valid=self.valid,
                    sigma_px=self.sigma_px,
                    source=self.source,
                    sigma_tangent_px=self.sigma_tangent_px,
                    confidence=self.confidence,
                    **more,
                )
        except OSError as error:
            raise TracksError(f"{path}: cannot be written ({error.strerror}).", "Choose another --out.") from error

    def nodes_mm(self, work_plane: WorkPlane) -> npt.NDArray[np.float32]:
        """(T, M, 2) float32 mm on the work plane."""
        flat = work_plane.mm(self.nodes.reshape(-1, 2).astype(np.float64))
        return np.asarray(flat.reshape(self.nodes.shape), dtype=np.float32)


def make_tracks(
    times_us: npt.NDArray[Any],
    nodes: npt.NDArray[Any],
    ids: npt.NDArray[Any] | None = None,
    valid: npt.NDArray[Any] | None = None,
    sigma_px: npt.NDArray[Any] | None = None,
    source: npt.NDArray[Any] | None = None,
    sigma_tangent_px: npt.NDArray[Any] | None = None,
    confidence: npt.NDArray[Any] | None = None,
    name: str = "tracks",
) -> Tracks:
    """Check arrays and fill in the optional ones (ids 0, valid True, sigmas and confidence NaN, source "").

    Shapes as in :class:`Tracks`. Raises TracksError that names ``name``, the array and what is wrong with it.
    """
    times_us = np.asarray(times_us)
    nodes = np.asarray(nodes)
    if times_us.ndim != 1 or times_us.dtype.kind not in "iu":
        raise _wrong(name, "times_us", times_us, "(T,) of integers")
    rows = len(times_us)
    if nodes.ndim != 3 or nodes.shape[0] != rows or nodes.shape[2] != 2 or nodes.dtype.kind != "f":
        raise _wrong(name, "nodes", nodes, f"({rows}, M, 2) of floats")
    count = nodes.shape[1]
    if rows and count < 2:
        raise _wrong(name, "nodes", nodes, "at least 2 nodes a row")
    if rows and (np.diff(times_us.astype(np.int64)) < 0).any():
        raise TracksError(f"{name}: times_us goes backwards.", "Sort the rows by time.")
    ids = np.zeros(rows, np.int64) if ids is None else np.asarray(ids)
    if ids.shape != (rows,) or ids.dtype.kind not in "iu":
        raise _wrong(name, "ids", ids, f"({rows},) of integers")
    valid = np.ones(rows, np.bool_) if valid is None else np.asarray(valid)
    if valid.shape != (rows,) or valid.dtype.kind not in "biu":
        raise _wrong(name, "valid", valid, f"({rows},) of booleans")
    sigma_px = _floats(name, "sigma_px", sigma_px, (rows, count))
    sigma_tangent_px = _floats(name, "sigma_tangent_px", sigma_tangent_px, (rows, count))
    confidence = _floats(name, "confidence", confidence, (rows,))
    source = np.zeros(rows, _SOURCE_DTYPE) if source is None else np.asarray(source)
    if source.shape != (rows,) or source.dtype.kind not in "US":
        raise _wrong(name, "source", source, f"({rows},) of strings")
    finite = np.isfinite(nodes).all(axis=(1, 2))
    # Absurd coordinates stay estimates, and absurd, but their squares must not overflow.
    nodes = np.clip(nodes, -_FARTHEST_PX, _FARTHEST_PX)
    return Tracks(
        times_us=times_us.astype(np.int64),
        nodes=nodes.astype(np.float32),
        ids=ids.astype(np.int64),
        valid=valid.astype(np.bool_) & finite,
        sigma_px=sigma_px,
        source=source.astype(_SOURCE_DTYPE),
        sigma_tangent_px=sigma_tangent_px,
        confidence=confidence,
    )


def load_tracks(path: Path) -> Tracks:
    """Read ``tracks.npz``. Raises TracksError naming the file and the array that is absent or wrong."""
    if not path.is_file():
        raise TracksError(f"{path}: no such file.", "Make it with: motiondlo track RECORDING --out tracks.npz")
    arrays = read_archive(path, TracksError, f"It must hold {_FIELDS}.")
    for key in ("times_us", "nodes"):
        if key not in arrays:
            raise TracksError(f"{path}: has no array {key}.", f"It must hold {_FIELDS}.")
    optional = {
        key: arrays.get(key) for key in ("ids", "valid", "sigma_px", "source", "sigma_tangent_px", "confidence")
    }
    return make_tracks(arrays["times_us"], arrays["nodes"], name=str(path), **optional)


class TracksBuilder:
    """Collects rows in time order; chains of different node counts are resampled to the longest one."""

    def __init__(self) -> None:
        self._times_us: list[int] = []
        self._ids: list[int] = []
        self._nodes: list[npt.NDArray[np.float64]] = []
        self._sigma_px: list[npt.NDArray[np.float64]] = []
        self._sigma_tangent_px: list[npt.NDArray[np.float64]] = []
        self._source: list[str] = []
        self._confidence: list[float] = []

    def add(
        self,
        t_us: int,
        track_id: int,
        nodes: npt.NDArray[np.float64],
        sigma_px: npt.NDArray[np.float64],
        source: str,
        sigma_tangent_px: npt.NDArray[np.float64] | None = None,
        confidence: float = float("nan"),
    ) -> None:
        """Append one row. nodes: (M, 2) event px; sigma_px, sigma_tangent_px: (M,) event px."""
        self._times_us.append(t_us)
        self._ids.append(track_id)
        self._nodes.append(nodes)
        self._sigma_px.append(sigma_px)
        self._sigma_tangent_px.append(np.full(len(nodes), np.nan) if sigma_tangent_px is None else sigma_tangent_px)
        self._source.append(source)
        self._confidence.append(confidence)

    def build(self) -> Tracks:
        """All rows so far. Raises TracksError when times went backwards."""
        rows = len(self._times_us)
        count = max((len(nodes) for nodes in self._nodes), default=2)
        nodes = np.empty((rows, count, 2), np.float32)
        sigma_px = np.empty((rows, count), np.float32)
        sigma_tangent_px = np.empty((rows, count), np.float32)
        places = np.linspace(0.0, 1.0, count)
        for row, (chain, sigma, along) in enumerate(
            zip(self._nodes, self._sigma_px, self._sigma_tangent_px, strict=True)
        ):
            if len(chain) == count:
                nodes[row], sigma_px[row], sigma_tangent_px[row] = chain, sigma, along
            else:
                nodes[row] = resample(chain, count)
                at = np.linspace(0.0, 1.0, len(sigma))
                sigma_px[row], sigma_tangent_px[row] = np.interp(places, at, sigma), np.interp(places, at, along)
        return make_tracks(
            np.array(self._times_us, np.int64),
            nodes,
            ids=np.array(self._ids, np.int64),
            sigma_px=sigma_px,
            source=np.array(self._source, _SOURCE_DTYPE),
            sigma_tangent_px=sigma_tangent_px,
            confidence=np.array(self._confidence, np.float32),
        )


def _floats(name: str, key: str, array: npt.NDArray[Any] | None, shape: tuple[int, ...]) -> npt.NDArray[np.float32]:
    """An optional array of floats, NaN where it is absent."""
    array = np.full(shape, np.nan, np.float32) if array is None else np.asarray(array)
    if array.shape != shape or array.dtype.kind != "f":
        expected = ", ".join(map(str, shape)) + ("," if len(shape) == 1 else "")
        raise _wrong(name, key, array, f"({expected}) of floats")
    return array.astype(np.float32)


def _wrong(name: str, key: str, array: npt.NDArray[Any], expected: str) -> TracksError:
    return TracksError(
        f"{name}: {key} is {array.shape} of {array.dtype}, expected {expected}.", f"It must hold {_FIELDS}."
    )
