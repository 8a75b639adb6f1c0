"""Read ``.npz`` archives that people hand over."""

from __future__ import annotations

import zipfile
import zlib
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from motiondlo.errors import MotionDLOError


def read_archive(path: Path, error_type: type[MotionDLOError], remedy: str) -> dict[str, npt.NDArray[Any]]:
    """All arrays of an ``.npz`` file; nothing in it is executed. Raises ``error_type`` when it cannot be read."""
    # Opened here and not by numpy, which leaves the file open when the archive is damaged.
    try:
        with path.open("rb") as file:
            archive = np.load(file, allow_pickle=False)
            if not isinstance(archive, np.lib.npyio.NpzFile):
                raise error_type(f"{path}: no .npz archive.", remedy)
            with archive:
                return {key: archive[key] for key in archive.files}
    except (OSError, ValueError, EOFError, zipfile.BadZipFile, zlib.error) as error:
        raise error_type(f"{path}: not a readable .npz file ({error}).", remedy) from error
