"""Regions that the tracker leaves out: are they where they should be, do they leave enough, will they be kept?"""

from __future__ import annotations

import os
from pathlib import Path

from motiondlo.config.cell import Cell
from motiondlo.config.loader import load_section
from motiondlo.events.screening_regions import covers_nothing, region_mask
from motiondlo_services.doctor.findings import Finding, failure, ok, warning
from motiondlo_services.event_tracker.config import EventTrackerConfig

_MUCH = 0.6


def check_regions(cell: Cell) -> list[Finding]:
    """Findings about ``[event_tracker.regions]`` of a valid configuration; none where there are no regions."""
    section = load_section(cell.path, "event_tracker", EventTrackerConfig)
    if not section.regions:
        return []
    if section.profile == "paper":
        return [warning("regions", "the paper's profile does not leave regions out", 'Use profile = "default".')]
    findings = [
        failure("regions", f"{name} touches no pixel of the event sensor", "Give its corners in event px.")
        for name, corners in section.regions.items()
        if covers_nothing(corners, cell.geometry)
    ]
    share = float(region_mask(section.regions, cell.geometry).mean())
    text = f"{len(section.regions)} left out, {100 * share:.0f} % of the event image"
    if share > _MUCH:
        findings.append(warning("regions", text, "A DLO is not seen there: leave out what must be, and no more."))
    return findings or [ok("regions", text)]


def check_state_folder(cell: Cell) -> list[Finding]:
    """Whether what commands change can be kept; nothing where the configuration names no folder."""
    folder = cell.state_folder
    if folder is None:
        return []
    there = _nearest_existing(folder)
    if not there.is_dir() or not os.access(there, os.W_OK | os.X_OK):
        return [failure("state folder", f"{folder} cannot be written", "Give [cell] state_folder a folder that can.")]
    return [ok("state folder", f"regions set by command are kept in {folder}")]


def _nearest_existing(path: Path) -> Path:
    while not path.exists():
        path = path.parent
    return path
