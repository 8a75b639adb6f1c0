"""A short simulated recording that comes with the package, for the demonstration and for tests."""

from __future__ import annotations

from pathlib import Path


def bundled_recording() -> Path:
    """Folder of the recording: 0.6 s of a tube that a gripper sweeps over a board at 1.2 m/s, with ground truth."""
    return Path(__file__).resolve().parent / "recording"
