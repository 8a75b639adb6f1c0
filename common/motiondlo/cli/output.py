"""Write result files; a place that cannot be written is a failure with one line."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from motiondlo.errors import MotionDLOError


def write_text(path: Path, text: str) -> None:
    """Write UTF-8 text. Raises MotionDLOError when the file cannot be written."""
    try:
        path.write_text(text, encoding="utf-8")
    except OSError as error:
        raise MotionDLOError(f"{path}: cannot be written ({error.strerror}).", "Choose another place.") from error


def write_bytes(path: Path, data: bytes) -> None:
    """Write a picture or the like. Raises MotionDLOError when the file cannot be written."""
    try:
        path.write_bytes(data)
    except OSError as error:
        raise MotionDLOError(f"{path}: cannot be written ({error.strerror}).", "Choose another place.") from error


def write_json(path: Path, document: dict[str, Any]) -> None:
    """Write a JSON document (no NaN: absent figures are null). Raises MotionDLOError when it cannot be written."""
    write_text(path, json.dumps(document, indent=1, allow_nan=False) + "\n")


def check_writable(path: Path) -> None:
    """Refuse an output file whose folder does not exist, before the work is done rather than after it."""
    if not path.parent.is_dir():
        raise MotionDLOError(f"{path}: there is no folder {path.parent}.", "Make it, or choose another place.")
