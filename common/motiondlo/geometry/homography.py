"""Homographies between image planes; named ``target_from_source``."""

from __future__ import annotations

import math
import re
from pathlib import Path
from typing import Literal

import numpy as np
import numpy.typing as npt

from motiondlo.errors import CalibrationError

FloatArray = npt.NDArray[np.float64]

# A plane seen by two cameras gives condition numbers up to about 1e7 in pixels; beyond this it cannot be inverted.
_MAX_CONDITION = 1e12
_MAX_FILE_BYTES = 1 << 16
_HEADER = re.compile(
    rb"\s*\{\s*'descr':\s*'(?P<dtype>[<>]f[248]|[<>][iu][248]|\|[iu]1)',\s*'fortran_order':\s*(?P<fortran>True|False),"
    rb"\s*'shape':\s*\((?P<shape>[0-9 ,]{0,40})\)\s*,?\s*\}\s*"
)


def checked_homography(matrix: npt.NDArray[np.generic], name: str = "homography") -> FloatArray:
    """Return ``matrix`` as (3, 3) float64, scaled so that its last element is 1.

    Raises CalibrationError when the shape is wrong, a value is not finite, or the matrix is singular.
    """
    if matrix.shape != (3, 3):
        raise CalibrationError(f"{name}: shape {matrix.shape}, expected (3, 3).", "Calibrate it again.")
    if matrix.dtype.kind not in "fiu":
        raise CalibrationError(f"{name}: {matrix.dtype} is no real number type.", "Calibrate it again.")
    with np.errstate(over="ignore"):
        h = matrix.astype(np.float64)
    if not np.isfinite(h).all():
        raise CalibrationError(f"{name}: contains values that are not finite.", "Calibrate it again.")
    if abs(h[2, 2]) < 1e-12 or np.linalg.cond(h) > _MAX_CONDITION:
        raise CalibrationError(f"{name}: singular, it cannot be inverted.", "Calibrate it again.")
    return np.asarray(h / h[2, 2], dtype=np.float64)


def load_homography(path: Path) -> FloatArray:
    """Read a 3x3 homography from a ``.npy`` file. Raises CalibrationError naming the file."""
    if not path.is_file():
        raise CalibrationError(f"{path}: no such file.", "Calibrate the cell, or use --mode event, which needs none.")
    try:
        with path.open("rb") as file:
            data = file.read(_MAX_FILE_BYTES + 1)
        matrix = _array_of(data)
    except (OSError, ValueError, EOFError) as error:
        raise CalibrationError(f"{path}: not a readable .npy file ({error}).", "Calibrate it again.") from error
    return checked_homography(matrix, str(path))


def _array_of(data: bytes) -> npt.NDArray[np.generic]:
    """The array in the bytes of a ``.npy`` file of real numbers. Raises ValueError.

    Read here because numpy's own reader evaluates the header as Python text, and allocates whatever it asks for.
    """
    if len(data) > _MAX_FILE_BYTES:
        raise ValueError("it is too large for a matrix")
    if data[:6] != b"\x93NUMPY" or len(data) < 12 or data[6] not in (1, 2, 3):
        raise ValueError("it does not begin as one")
    start = 10 if data[6] == 1 else 12
    stop = start + int.from_bytes(data[8:start], "little")
    header = _HEADER.fullmatch(data[start:stop])
    if header is None:
        raise ValueError("its header does not describe an array of real numbers")
    dtype = np.dtype(header["dtype"].decode())
    shape = tuple(int(length) for length in header["shape"].replace(b",", b" ").split())
    if math.prod(shape) * dtype.itemsize != len(data) - stop:
        raise ValueError(f"{len(data) - stop} bytes do not hold {shape} of {dtype}")
    order: Literal["C", "F"] = "F" if header["fortran"] == b"True" else "C"
    return np.frombuffer(data, dtype, offset=stop).reshape(shape, order=order)


def warp_points(points: FloatArray, target_from_source: FloatArray) -> FloatArray:
    """Map points by a homography (paper, "Polyline fitting": point-level warp). (N, 2) -> (N, 2) float64."""
    h = np.concatenate([points, np.ones((len(points), 1))], axis=1) @ target_from_source.T
    return np.asarray(h[:, :2] / h[:, 2:], dtype=np.float64)
