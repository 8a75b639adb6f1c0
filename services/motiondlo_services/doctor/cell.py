"""The cell: its configuration, recording, calibration, segmenter, endpoints."""

from __future__ import annotations

import socket
from pathlib import Path

import numpy as np

from motiondlo.config.cell import Cell
from motiondlo.errors import MotionDLOError
from motiondlo.events.reader import open_events
from motiondlo.geometry.homography import warp_points
from motiondlo_services.cell_config import bus_section, check_configuration
from motiondlo_services.doctor.cameras import check_cameras
from motiondlo_services.doctor.findings import Finding, failure, ok, warning
from motiondlo_services.doctor.lenses import check_lenses
from motiondlo_services.doctor.regions import check_regions, check_state_folder
from motiondlo_services.doctor.security import check_security
from motiondlo_services.doctor.segmenter import check_segmenter
from motiondlo_services.runtime.bus_section import BusSection


def check_cell(path: Path) -> list[Finding]:
    """Every finding about the cell of a configuration file."""
    try:
        cell = check_configuration(path)
    except MotionDLOError as error:
        return [failure("configuration", error.what, error.what_to_do)]
    findings = [ok("configuration", f"{path}: every section is valid")]
    findings += _recording(cell)
    findings += [_homography(cell), *check_lenses(cell), _background(cell), _scale(cell)]
    findings += check_segmenter(cell)
    findings += check_regions(cell)
    findings += check_state_folder(cell)
    findings += _endpoints(bus_section(path))
    findings += check_security(cell, bus_section(path))
    return findings


def _recording(cell: Cell) -> list[Finding]:
    try:
        recording = cell.recording()
        if recording is None:
            return check_cameras(cell.path)
        events = open_events(recording.events_path)
    except MotionDLOError as error:
        return [failure("recording", error.what, error.what_to_do)]
    findings = [ok("recording", f"{recording.name}: {events.format}, {len(recording.frames)} frames with triggers")]
    if (events.geometry.width_px, events.geometry.height_px) != (cell.geometry.width_px, cell.geometry.height_px):
        findings.append(
            failure(
                "sensor size",
                f"[calibration] says {cell.geometry.width_px}x{cell.geometry.height_px}, the recording "
                f"{events.geometry.width_px}x{events.geometry.height_px}",
                "Correct sensor_width_px and sensor_height_px.",
            )
        )
    for reason, count in recording.rejects.items():
        findings.append(
            warning("frames", f"{count} x {reason.value}", "The event branch goes on without them; see manifest.json.")
        )
    return findings


def _homography(cell: Cell) -> Finding:
    try:
        matrix = cell.event_from_rgb()
    except MotionDLOError as error:
        return failure("homography", error.what, error.what_to_do)
    corners = np.array([[0.0, 0.0], [cell.geometry.width_px, 0.0], [0.0, cell.geometry.height_px]])
    seen = warp_points(corners, np.asarray(np.linalg.inv(matrix), dtype=np.float64))
    if not np.isfinite(seen).all() or abs(np.linalg.det(np.diff(seen, axis=0))) < 1.0:
        return failure("homography", "maps the event image onto next to nothing", "Calibrate it again.")
    return ok("homography", "event_from_rgb can be inverted")


def _background(cell: Cell) -> Finding:
    try:
        image = cell.background()
    except MotionDLOError as error:
        return failure("background", error.what, error.what_to_do)
    if image is None:
        return warning(
            "background", "no picture of the empty board", "Take one: the classical segmenter is better with it."
        )
    return ok("background", f"{image.shape[1]}x{image.shape[0]} px")


def _scale(cell: Cell) -> Finding:
    try:
        plane = cell.work_plane()
    except MotionDLOError as error:
        return failure("scale", error.what, error.what_to_do)
    if plane is None:
        return warning(
            "scale", "no scale is known", "Set [calibration] px_per_mm or work_plane to have nodes_mm in the state."
        )
    least, most = plane.px_per_mm_over(cell.geometry.width_px, cell.geometry.height_px)
    if not 0.1 <= least <= most <= 200.0 or most > 3.0 * least:
        return failure(
            "scale", f"from {least:.3g} to {most:.3g} px/mm over the event image: not plausible", "Calibrate it again."
        )
    return ok("scale", f"{least:.3f} px/mm" if most - least < 5e-4 else f"{least:.3f} to {most:.3f} px/mm")


def _endpoints(section: BusSection) -> list[Finding]:
    findings = []
    for daemon, endpoint in section.all_endpoints().items():
        protocol, _, address = endpoint.partition("/")
        host, _, port = address.rpartition(":")
        if protocol != "tcp":
            continue
        family = socket.AF_INET6 if host.startswith("[") else socket.AF_INET
        with socket.socket(family, socket.SOCK_STREAM) as probe:
            probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            try:
                probe.bind((host.strip("[]"), int(port)))
            except OSError:
                findings.append(
                    warning(
                        "endpoints",
                        f"{daemon}: {endpoint} is in use",
                        "Fine if the cell is running; otherwise set [bus] first_port.",
                    )
                )
    return findings or [ok("endpoints", "all free, all within this host")]
