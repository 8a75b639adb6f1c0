"""The event ingest of a live cell: reads the event camera until told to stop, whether it is there or not."""

from __future__ import annotations

import time
from collections.abc import Callable

import numpy as np

from motiondlo.bus.session import Bus
from motiondlo.cameras.config import CamerasSection
from motiondlo.cameras.factory import event_camera
from motiondlo.cameras.link import CameraLink
from motiondlo.config.loader import load_section
from motiondlo.events.evt3 import Evt3Decoder
from motiondlo.events.types import EVENT_DTYPE, SensorGeometry
from motiondlo.events.writer import Evt3Encoder
from motiondlo_services.event_ingest.config import EventIngestConfig
from motiondlo_services.event_ingest.core import EventIngestCore
from motiondlo_services.event_ingest.sending import Sender
from motiondlo_services.runtime.shell import Shell

READ_S = 0.02
MAX_PAUSE_S = 0.1


def serve_camera(shell: Shell, bus: Bus, config: EventIngestConfig, resume_us: Callable[[Bus], int]) -> None:
    """Read until told to stop. resume_us: event time at which a running cell is, -1 for a new one.

    Raises ConfigError when no camera is configured, DriverMissing when its driver is not installed.
    """
    section = load_section(shell.config_path, "cameras", CamerasSection)
    camera = event_camera(section, shell.config_path)
    link = CameraLink(camera, section.event.stall_ms * 1e-3, time.monotonic_ns)
    core = EventIngestCore(None, config.batch_us, config.max_backlog)
    lost_packets = 0

    def figures() -> dict[str, bool | int | float | str]:
        report = link.report
        return {
            "camera": camera.name,
            "camera_connected": report.connected,
            "camera_outages": report.outages,
            "camera_lost_packets": lost_packets,
            "epoch": core.epoch,
            **{f"damage {kind}": count for kind, count in core.damage.items()},
        }

    sender = Sender(shell, bus, core, figures)
    shell.ready()
    connections = 0
    try:
        while shell.running:
            chunk = link.read(READ_S)
            report = link.report
            if report.connections != connections:
                connections = report.connections
                core.attach(
                    Evt3Decoder(shell.cell.geometry), time.monotonic_ns(), resume_us(bus) if core.t_us < 0 else -1
                )
            if chunk is not None:
                lost_packets += chunk.lost_packets
                core.push(chunk.raw, chunk.arrived_ns)
            changed, sender.problem = sender.problem != report.problem, report.problem
            shell.problems = (report.problem,) if report.problem else ()
            sender.send(now=changed)
            if not report.connected:
                time.sleep(min(link.pause_s, MAX_PAUSE_S))
    finally:
        link.close()


def compile_kernels(geometry: SensorGeometry, batch_us: int) -> None:
    """Decode and cut a few events, so that nothing is compiled while the camera sends."""
    events = np.zeros(64, EVENT_DTYPE)
    events["t"] = np.arange(64) * batch_us // 8
    core = EventIngestCore(Evt3Decoder(geometry), batch_us)
    core.push(Evt3Encoder(geometry).encode(events), 1)
    core.finish(2)
