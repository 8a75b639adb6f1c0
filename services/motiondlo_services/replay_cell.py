"""Write the configuration of a cell that plays a recording on ports of its own (demonstration, benchmark, tests)."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path

from motiondlo.recording.layout import open_recording
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
