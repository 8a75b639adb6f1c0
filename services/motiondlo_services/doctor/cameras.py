"""The cell's cameras: drivers, devices, permissions, trigger line."""

from __future__ import annotations

import os
from pathlib import Path

from motiondlo.cameras.config import CamerasSection, FrameCameraSection
from motiondlo.cameras.factory import event_camera, frame_camera
from motiondlo.cameras.interface import Camera, CameraLost, DriverMissing
from motiondlo.config.loader import load_section
from motiondlo.errors import MotionDLOError
from motiondlo_services.doctor.findings import Finding, failure, ok, warning

UDEV_FOLDERS = (Path("/etc/udev/rules.d"), Path("/usr/lib/udev/rules.d"), Path("/lib/udev/rules.d"))
EVK4_VENDOR = "04b4"


def check_cameras(path: Path) -> list[Finding]:
    """Every finding about the cameras of a configuration file without a recording."""
    try:
        section = load_section(path, "cameras", CamerasSection)
        findings = _camera("event camera", event_camera(section, path), section.event.serial)
    except DriverMissing as missing:
        findings = [failure("event camera driver", missing.what, missing.what_to_do)]
    except MotionDLOError as error:
        return [failure("source", error.what, error.what_to_do)]
    if section.event.driver == "neuromorphic":
        findings.append(_usb_permissions())
    try:
        camera = frame_camera(section, path)
    except DriverMissing as missing:
        return [*findings, failure("RGB camera driver", missing.what, missing.what_to_do)]
    except MotionDLOError as error:
        return [*findings, failure("RGB camera", error.what, error.what_to_do)]
    if camera is None:
        findings.append(
            warning("RGB camera", "[cameras.frame] has no driver", "Name one: without frames no DLO gets its shape.")
        )
        return findings
    return [*findings, *_camera("RGB camera", camera, section.frame.device), _trigger_line(section.frame)]


def _camera(subject: str, camera: Camera, wanted: str) -> list[Finding]:  # type: ignore[type-arg]
    findings = [ok(f"{subject} driver", f"{type(camera).__name__} is installed")]
    try:
        devices = camera.find()
    except CameraLost as lost:
        return [*findings, failure(subject, lost.what, lost.what_to_do or "Look at the driver's own diagnostics.")]
    hits = [device for device in devices if not wanted or wanted in (device.serial, device.name)]
    if not hits:
        seen = ", ".join(f"{device.name} {device.serial}".strip() for device in devices) or "none"
        return [
            *findings,
            failure(subject, f"{wanted or 'no device'} not found; there are: {seen}", "Is it plugged in?"),
        ]
    if hits[0].problem:
        return [
            *findings,
            failure(
                subject, f"{hits[0].name}: {hits[0].problem}", "Give the daemons' user access to it, or end its user."
            ),
        ]
    return [*findings, ok(subject, f"{hits[0].name} {hits[0].serial}".strip())]


def _usb_permissions() -> Finding:
    """Whether a rule lets the daemons' user open the camera."""
    rules = [path for folder in UDEV_FOLDERS if folder.is_dir() for path in folder.glob("*.rules")]
    for path in rules:
        try:
            if EVK4_VENDOR in path.read_text(encoding="utf-8", errors="replace"):
                return ok("USB permissions", f"a rule is in {path}")
        except OSError:
            continue
    if os.geteuid() == 0:
        return ok("USB permissions", "root may open every device")
    return warning(
        "USB permissions",
        "no udev rule lets this user open the event camera",
        "neuromorphic-drivers-install-udev-rules",
    )


def _trigger_line(section: FrameCameraSection) -> Finding:
    """Whether frames can be told apart by their triggers."""
    width_ms = section.max_latency_ms - section.min_latency_ms
    if width_ms >= section.min_trigger_interval_ms:
        return warning(
            "trigger line",
            f"frames arrive within {width_ms:g} ms, but triggers are only {section.min_trigger_interval_ms:g} ms apart:"
            " frames are paired only if the camera has a clock, and its delays vary enough to learn it",
            "Narrow [cameras.frame] min_latency_ms and max_latency_ms, or trigger less often.",
        )
    if section.driver == "genicam" and not section.exposure_line:
        return warning(
            "trigger line",
            "no output of the RGB camera is set to tell the event camera of exposures",
            "Set [cameras.frame] exposure_line, unless the trigger signal itself goes to both cameras.",
        )
    if section.driver == "opencv":
        return warning(
            "trigger line",
            "OpenCV cannot set up a trigger: frames are paired only if something else triggers both cameras",
            "Wire the camera's strobe output to the event camera's trigger input.",
        )
    return ok("trigger line", f"a frame arrives within {width_ms:g} ms, triggers are further apart")
