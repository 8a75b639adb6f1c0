"""The frame capture's shell: triggers and requests in, frames out. A camera, or the frames of a recording."""

from __future__ import annotations

import sys
import time

from motiondlo.bus.session import Bus
from motiondlo.messages.frame import FrameMessage
from motiondlo.recording.layout import read_image
from motiondlo.rejects import RejectReason
from motiondlo.topics import EVENTS_TRIGGER, FRAME
from motiondlo_services.frame_capture.config import FrameCaptureConfig
from motiondlo_services.frame_capture.core import Capture, CaptureCore
from motiondlo_services.frame_capture.live import serve_camera
from motiondlo_services.runtime.shell import Shell, run_daemon

WAIT_S = 0.1
RISING = 1


def serve(shell: Shell, bus: Bus) -> None:
    """Capture until told to stop."""
    # Configuration and core.
    config = shell.section(FrameCaptureConfig)
    recording = shell.cell.recording()
    if recording is None:
        serve_camera(shell, bus, config)
        return
    core = CaptureCore(recording.frames, config.pairing_tolerance_us, config.publish_all)
    for reason, count in recording.rejects.items():
        core.rejects.count(reason, n=count)
    requests: dict[int, str] = {}

    # Bus.
    triggers = bus.subscriber(EVENTS_TRIGGER)
    commands = bus.serve(("segment",))
    frames = bus.publisher(FRAME)
    shell.ready()

    def publish(captures: list[Capture]) -> None:
        for capture in captures:
            image = read_image(capture.entry.path)
            if image is None:
                core.skip(capture.entry, RejectReason.FRAME_UNREADABLE)
                if capture.request_id:
                    core.ask_again(capture.request_id, capture.entry.t_us + 1)
                continue
            request_id = requests.pop(capture.request_id, "")
            frames.put(
                FrameMessage(
                    t_us=capture.entry.t_us,
                    name=capture.entry.name,
                    reason="request" if capture.request_id else "periodic",
                    request_id=request_id,
                    t_capture_ns=time.monotonic_ns(),
                    image=image,
                )
            )
            shell.counts["frames"] += 1

    # Loop.
    numbered = 0
    while shell.running:
        bus.wait(WAIT_S, triggers, commands)
        for message in triggers.drain():
            for trigger in message.triggers[message.triggers["edge"] == RISING]:
                shell.t_us = int(trigger["t"])
                publish(core.on_trigger(shell.t_us))
        while (command := commands.take()) is not None:
            args = command.request.args
            after_us, request_id = args.get("after_us", -1), args.get("request_id", "")
            if "cancel" in args:
                for number in [number for number, asked in requests.items() if asked == args["cancel"]]:
                    core.withdraw(number)
                command.answer()
                continue
            if not isinstance(after_us, int) or not isinstance(request_id, str):
                command.refuse("after_us must be an integer and request_id a text.", "Correct the request.")
                continue
            if not frames.has_readers():
                command.refuse("Nobody takes frames.", "Is the segmenter running?")
                continue
            numbered += 1
            requests = {numbered: request_id}
            command.answer({"accepted": True})
            publish(core.on_request(numbered, after_us))
        shell.tick({"triggers": core.triggers, "waiting": core.waiting}, core.rejects.as_dict())


def main() -> int:
    """Entry point of ``motiondlo-frame-capture``."""
    return run_daemon("frame-capture", serve)


if __name__ == "__main__":
    sys.exit(main())
