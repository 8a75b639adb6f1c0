"""The whole configuration of a cell: every section there is, checked together before anything starts."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from pydantic import BaseModel

from motiondlo.cameras.config import CamerasSection
from motiondlo.config.cell import CalibrationSection, Cell, CellSection, ReplaySection, load_cell
from motiondlo.config.loader import load_section, read_toml
from motiondlo.errors import ConfigError
from motiondlo.tracking.factory import tracker_params
from motiondlo_services.event_ingest.config import EventIngestConfig
from motiondlo_services.event_tracker.config import EventTrackerConfig
from motiondlo_services.frame_capture.config import FrameCaptureConfig
from motiondlo_services.fusion.config import FusionConfig
from motiondlo_services.gate.config import GateConfig
from motiondlo_services.processes import PROCESSES, Process
from motiondlo_services.runtime.bus_section import BusSection
from motiondlo_services.segmenter.config import SegmenterConfig

SECTIONS: dict[str, type[BaseModel]] = {
    "cell": CellSection,
    "calibration": CalibrationSection,
    "replay": ReplaySection,
    "cameras": CamerasSection,
    "bus": BusSection,
    "event_ingest": EventIngestConfig,
    "event_tracker": EventTrackerConfig,
    "fusion": FusionConfig,
    "frame_capture": FrameCaptureConfig,
    "segmenter": SegmenterConfig,
    "gate": GateConfig,
}


def check_configuration(path: Path) -> Cell:
    """Check every section of the file; the shared ones, ready for use.

    Raises ConfigError for an unknown section, or naming file, field, value and bound of whatever is wrong.
    """
    unknown = sorted(set(read_toml(path)) - set(SECTIONS))
    if unknown:
        raise ConfigError(f"{path}: [{unknown[0]}]: no such section.", f"Sections: {', '.join(SECTIONS)}.")
    for name, model in SECTIONS.items():
        section = load_section(path, name, model)
        if isinstance(section, EventTrackerConfig):
            try:
                tracker_params(section.profile, section.parameters)
            except ConfigError as error:
                raise ConfigError(f"{path}: [event_tracker.parameters] {error.what}", error.what_to_do) from error
    return load_cell(path)


def check_source(cell: Cell) -> None:
    """Before a cell starts: that it has a recording to play, or cameras whose drivers are installed.

    Raises RecordingError, ConfigError, or DriverMissing naming the extra to install.
    """
    if cell.recording() is None:
        from motiondlo.cameras.factory import event_camera, frame_camera

        section = load_section(cell.path, "cameras", CamerasSection)
        event_camera(section, cell.path)
        frame_camera(section, cell.path)


def bus_section(path: Path) -> BusSection:
    """The file's ``[bus]``. Raises ConfigError."""
    return load_section(path, "bus", BusSection)


def wanted_processes(path: Path) -> tuple[Process, ...]:
    """The rows of the daemons that this cell runs: all but those whose section says ``enabled = false``.

    With ``[cell] standby = false`` none of them stands by. Raises ConfigError.
    """
    sections = {row.name: load_section(path, row.section, SECTIONS[row.section]) for row in PROCESSES}
    standby = load_section(path, "cell", CellSection).standby
    return tuple(
        replace(row, standby=row.standby and standby)
        for row in PROCESSES
        if getattr(sections[row.name], "enabled", True)
    )
