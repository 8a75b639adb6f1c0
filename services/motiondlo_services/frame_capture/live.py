"""The frame capture of a live cell: camera frames, triggers and requests in, frames with their times out."""

from __future__ import annotations

import time
from typing import Any

from motiondlo.bus.inbox import wait_any
from motiondlo.bus.session import Bus
from motiondlo.cameras.config import CamerasSection, FrameCameraSection
from motiondlo.cameras.factory import frame_camera
from motiondlo.cameras.link import CameraLink
from motiondlo.cameras.pairing import PairingParams
from motiondlo.config.loader import load_section
from motiondlo.errors import ConfigError
from motiondlo.messages.frame import FrameMessage
from motiondlo.rejects import RejectReason
from motiondlo.topics import EVENTS_CLOCK, EVENTS_TRIGGER, FRAME
from motiondlo_services.frame_capture.config import FrameCaptureConfig
from motiondlo_services.frame_capture.live_core import LiveCapture, LiveCaptureCore
from motiondlo_services.frame_capture.reader import FrameReader
from motiondlo_services.runtime.shell import Shell

WAIT_S = 0.05
RISING = 1


def pairing_params(camera: FrameCameraSection, config: FrameCaptureConfig) -> PairingParams:
    """What the configuration knows of the trigger line."""
    return PairingParams(
        min_latency_us=int(camera.min_latency_ms * 1000),
        max_latency_us=int(camera.max_latency_ms * 1000),
        min_interval_us=int(camera.min_trigger_interval_ms * 1000),
        tolerance_us=config.pairing_tolerance_us,
    )


def serve_camera(shell: Shell, bus: Bus, config: FrameCaptureConfig) -> None:
    """Capture until told to stop. Raises ConfigError without any camera, DriverMissing without the driver's package."""
    # Configuration and core.
    section = load_section(shell.config_path, "cameras", CamerasSection)
    if not section.any:
        raise ConfigError(
            f"{shell.config_path}: [replay] recording is empty, and [cameras] has no driver.",
            "Name a recording to play, or the cameras' drivers.",
        )
    camera = frame_camera(section, shell.config_path)
    core = LiveCaptureCore(pairing_params(section.frame, config), config.publish_all)
    channel = section.event.trigger_channel
    requests: dict[int, str] = {}

    # Bus and camera.
    triggers = bus.subscriber(EVENTS_TRIGGER)
    clocks = bus.subscriber(EVENTS_CLOCK)
    commands = bus.serve(("segment",))
    frames = bus.publisher(FRAME)
    reader = (
        None if camera is None else FrameReader(CameraLink(camera, section.frame.stall_ms * 1e-3, time.monotonic_ns))
    )
    inboxes: list[Any] = [triggers.inbox, clocks.inbox, commands.inbox, *([] if reader is None else [reader.inbox])]
    clock = bus.last_value(EVENTS_CLOCK, timeout_s=0.3)
    if clock is not None:
        core.on_clock(clock.event_us, clock.epoch)
    shell.ready()

    def publish(captures: list[LiveCapture]) -> None:
        for capture in captures:
            paired = capture.paired
            frames.put(
                FrameMessage(
                    t_us=paired.t_us,
                    name=f"frame_{paired.trigger_id:06d}",
                    trigger_id=paired.trigger_id,
                    reason="request" if capture.request_id else "periodic",
                    request_id=requests.pop(capture.request_id, ""),
                    t_capture_ns=paired.frame.arrived_ns,
                    image=paired.frame.image,
                )
            )
            shell.counts["frames"] += 1

    # Loop.
    numbered = connections = 0
    problem = "" if reader is not None else "this cell has no RGB camera"
    try:
        while shell.running:
            wait_any(inboxes, WAIT_S)
            for clock in clocks.drain():
                core.on_clock(clock.event_us, clock.epoch)
            for message in triggers.drain():
                rising = message.triggers[
                    (message.triggers["edge"] == RISING) & (message.triggers["channel"] == channel)
                ]
                for t_us in rising["t"].tolist():
                    shell.t_us = t_us
                    core.on_trigger(t_us)
            changed = False
            if reader is not None:
                while (item := reader.inbox.take()) is not None:
                    if item[0] != connections:
                        connections = item[0]
                        core.on_camera()
                    if item[1].incomplete_before:
                        core.pairing.rejects.count(RejectReason.FRAME_UNREADABLE, n=item[1].incomplete_before)
                    core.on_frame(item[1])
                changed, problem = problem != reader.report.problem, reader.report.problem
            publish(core.step(time.monotonic_ns()))
            while (command := commands.take()) is not None:
                args = command.request.args
                after_us, request_id = args.get("after_us", -1), args.get("request_id", "")
                if "cancel" in args:
                    for number in [number for number, asked in requests.items() if asked == args["cancel"]]:
                        core.withdraw(number)
                    command.answer()
                elif not isinstance(after_us, int) or not isinstance(request_id, str):
                    command.refuse("after_us must be an integer and request_id a text.", "Correct the request.")
                elif problem:
                    command.refuse(f"No frame can be taken: {problem}.", "See health/frame-capture.")
                elif not frames.has_readers():
                    command.refuse("Nobody takes frames.", "Is the segmenter running?")
                else:
                    numbered += 1
                    requests = {numbered: request_id}
                    command.answer({"accepted": True})
                    publish(core.on_request(numbered, after_us, time.monotonic_ns()))
            shell.problems = (problem,) if problem and reader is not None else ()
            shell.lifecycle = "degraded" if shell.problems else "running"
            shell.tick(_figures(core, reader), core.pairing.rejects.as_dict(), now=changed)
    finally:
        if reader is not None:
            reader.close()


def _figures(core: LiveCaptureCore, reader: FrameReader | None) -> dict[str, bool | int | float | str]:
    figures: dict[str, bool | int | float | str] = {
        "triggers": core.triggers,
        "paired": core.paired,
        "waiting": core.waiting,
        "frames_lost": core.pairing.frames_lost,
        "frames_ambiguous": core.pairing.ambiguous,
        "pairs_refused": core.pairing.contradictions,
    }
    if reader is not None:
        report = reader.report
        figures |= {"camera_connected": report.connected, "camera_outages": report.outages}
    return figures
