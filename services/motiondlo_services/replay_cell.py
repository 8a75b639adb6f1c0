"""Write the configuration of a cell that plays a recording, on ports of its own or in the place of a cell's cameras."""

from __future__ import annotations

import json
import tempfile
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from motiondlo.config.loader import read_toml
from motiondlo.errors import ConfigError
from motiondlo.recording.layout import HOMOGRAPHY_FILE, open_recording
from motiondlo_services.live_run import free_first_port

Scalar = bool | int | float | str


def write_replay_cell(
    path: Path, recording: Path, name: str = "replay", sections: Mapping[str, Mapping[str, Scalar]] | None = None
) -> Path:
    """Write it to ``path``; ``sections``: further values by section. Raises RecordingError for what is no recording."""
    open_recording(recording)
    document: dict[str, dict[str, Scalar]] = {
        "cell": {"name": name},
        "replay": {"recording": str(recording.resolve())},
        "bus": {"first_port": free_first_port()},
    }
    for section, values in (sections or {}).items():
        document.setdefault(section, {}).update(values)
    lines = []
    for section, values in document.items():
        lines.append(f"[{section}]")
        # Numbers, truth values and strings are written alike in JSON and TOML.
        lines += [f"{key} = {json.dumps(value)}" for key, value in values.items()]
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return path


@contextmanager
def replay_config(config: Path | None, recording: Path, speed: float) -> Iterator[Path]:
    """A configuration that plays ``recording``, as long as it is needed.

    config: a cell's, of which all is kept but the cameras, and the calibration that the recording brings along; None:
    the defaults. Raises ConfigError and RecordingError.
    """
    open_recording(recording)
    document: dict[str, Any] = {"cell": {"name": "cell1"}} if config is None else read_toml(config)
    document.pop("cameras", None)
    calibration = document.get("calibration", {})
    for name, brought in (("event_from_rgb", HOMOGRAPHY_FILE), ("background", Path("background.jpg"))):
        if (recording / brought).is_file():
            calibration.pop(name, None)
    document["replay"] = {
        **document.get("replay", {}),
        "recording": str(recording.resolve()),
        "speed": float(speed),
    }
    # Beside the original: paths in it start there.
    beside = None if config is None else config.resolve().parent
    try:
        handle, name = tempfile.mkstemp(".toml", ".replay-", beside)
    except OSError as error:
        raise ConfigError(
            f"{beside}: a configuration for the replay cannot be written there ({error.strerror}).",
            "Copy the cell's configuration to a folder of your own.",
        ) from error
    try:
        with open(handle, "w", encoding="utf-8") as file:
            file.write("\n".join(toml_lines(document)) + "\n")
        yield Path(name)
    finally:
        Path(name).unlink()


def toml_lines(table: Mapping[str, Any], path: str = "") -> list[str]:
    """``table`` as lines of TOML: values first, then the tables within, each under its name."""
    # Numbers, truth values, strings and lists of them are written alike in JSON and TOML.
    lines = [f"{json.dumps(k)} = {json.dumps(v)}" for k, v in table.items() if not isinstance(v, Mapping)]
    for name, value in table.items():
        if isinstance(value, Mapping):
            inner = f"{path}.{json.dumps(name)}" if path else json.dumps(name)
            lines += ["", f"[{inner}]", *toml_lines(value, inner)]
    return lines
