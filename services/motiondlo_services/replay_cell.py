"""Write the configuration of a cell that plays a recording on ports of its own (demonstration, benchmark, tests)."""

from __future__ import annotations

import json
from pathlib import Path

from motiondlo.recording.layout import open_recording
from motiondlo_services.live_run import free_first_port


def write_replay_cell(
    path: Path,
    recording: Path,
    name: str = "replay",
    profile: str = "default",
    batch_us: int | None = None,
    extra: str = "",
) -> Path:
    """Write it to ``path``; ``extra``: further TOML. Raises RecordingError when ``recording`` is none.

    Strings of JSON are strings of TOML, so paths are written with json.dumps.
    """
    open_recording(recording)
    lines = [
        "[cell]",
        f"name = {json.dumps(name)}",
        "[replay]",
        f"recording = {json.dumps(str(recording.resolve()))}",
        "[bus]",
        f"first_port = {free_first_port()}",
        "[event_tracker]",
        f"profile = {json.dumps(profile)}",
    ]
    if batch_us is not None:
        lines += ["[event_ingest]", f"batch_us = {batch_us}"]
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text("\n".join(lines) + "\n" + extra, encoding="utf-8")
    return path
