"""Write calibration files so that a crash or a mistake never costs the old one."""

from __future__ import annotations

import json
import os
import tempfile
from io import BytesIO
from pathlib import Path

import numpy as np
import numpy.typing as npt

from motiondlo.errors import CalibrationError
from motiondlo.geometry.lens import LensModel


def save_homography(path: Path, event_from_rgb: npt.NDArray[np.float64]) -> Path | None:
    """Write a 3x3 matrix as .npy; see :func:`save_calibration`."""
    data = BytesIO()
    np.save(data, event_from_rgb)
    return save_calibration(path, data.getvalue())


def save_lens(path: Path, lens: LensModel) -> Path | None:
    """Write a lens file that ``load_lens`` reads; see :func:`save_calibration`."""
    document = {
        "width": lens.size_px[0],
        "height": lens.size_px[1],
        "camera_matrix": lens.camera_matrix.tolist(),
        "distortion": lens.distortion.tolist(),
    }
    return save_calibration(path, (json.dumps(document, indent=1, allow_nan=False) + "\n").encode())


def save_calibration(path: Path, data: bytes) -> Path | None:
    """Replace ``path`` at once; what was there before is kept beside it as ``.bak``.

    Returns the backup's path, None when there was no old file. Raises CalibrationError when it cannot be written.
    """
    backup = path.with_name(path.name + ".bak")
    temporary = ""
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.NamedTemporaryFile(dir=path.parent, suffix=".tmp", delete=False) as file:
            temporary = file.name
            file.write(data)
            file.flush()
            os.fsync(file.fileno())
        # Temporary files are private to the user; a calibration is read by daemons of another.
        os.chmod(temporary, 0o644)
        had_one = path.is_file()
        if had_one:
            backup.unlink(missing_ok=True)
            os.link(path, backup)
        os.replace(temporary, path)
    except OSError as error:
        if temporary:
            Path(temporary).unlink(missing_ok=True)
        raise CalibrationError(f"{path}: cannot be written ({error.strerror}).", "Choose another place.") from error
    return backup if had_one else None
