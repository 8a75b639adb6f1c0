"""The driver that the configuration names."""

from __future__ import annotations

from pathlib import Path

from motiondlo.cameras.config import CamerasSection
from motiondlo.cameras.interface import EventCamera, FrameCamera
from motiondlo.errors import ConfigError


def event_camera(section: CamerasSection, config: Path) -> EventCamera:
    """The cell's event camera, not yet open. ``config``: the file, for messages and relative paths.

    Raises ConfigError when none is configured, DriverMissing when its driver's package is not installed.
    """
    if section.event.driver == "neuromorphic":
        from motiondlo.cameras.neuromorphic import NeuromorphicCamera

        return NeuromorphicCamera(section.event)
    if section.event.driver == "simulated":
        from motiondlo.cameras.simulated_events import SimulatedEventCamera

        return SimulatedEventCamera(section.simulated, simulated_recording(section, config))
    raise ConfigError(
        f"{config}: nothing to read: [replay] recording is empty, and so is [cameras.event] driver.",
        "Name a recording to play, or the driver of the event camera.",
    )


def frame_camera(section: CamerasSection, config: Path) -> FrameCamera | None:
    """The cell's RGB camera, not yet open; None when none is configured. Raises as :func:`event_camera`."""
    if section.frame.driver == "genicam":
        from motiondlo.cameras.genicam import GenICamCamera

        return GenICamCamera(section.frame)
    if section.frame.driver == "opencv":
        from motiondlo.cameras.opencv import OpenCvCamera

        return OpenCvCamera(section.frame)
    if section.frame.driver == "simulated":
        from motiondlo.cameras.simulated_frames import SimulatedFrameCamera

        return SimulatedFrameCamera(section.simulated, simulated_recording(section, config))
    return None


def simulated_recording(section: CamerasSection, config: Path) -> Path:
    """The folder that simulated cameras see. Raises ConfigError when none is named."""
    if not section.simulated.recording:
        raise ConfigError(
            f"{config}: [cameras.simulated] recording is empty.", "Name the recording that the simulated cameras see."
        )
    return (config.parent / Path(section.simulated.recording).expanduser()).resolve()
