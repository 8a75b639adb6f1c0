"""The segmenter's shell: frames in, segmentations out; one frame at a time, the newest first."""

from __future__ import annotations

import sys

from motiondlo.bus.session import Bus
from motiondlo.frames.backend import create_backend
from motiondlo.frames.pipeline import segment_frame
from motiondlo.frames.types import Segmentation
from motiondlo.messages.frame import FrameMessage
from motiondlo.messages.segmentation import SegmentationMessage
from motiondlo.topics import FRAME, SEGMENTATION
from motiondlo_services.runtime.shell import Shell, run_daemon
from motiondlo_services.segmenter.config import SegmenterConfig

WAIT_S = 0.2


def serve(shell: Shell, bus: Bus) -> None:
    """Segment until told to stop."""
    # Configuration and core.
    config = shell.section(SegmenterConfig)
    backend = create_backend(config)
    event_from_rgb = shell.cell.event_from_rgb()
    background = shell.cell.background()

    # Bus.
    frames = bus.subscriber(FRAME)
    segmentations = bus.publisher(SEGMENTATION)
    shell.ready()

    def segment(message: FrameMessage) -> Segmentation:
        image = message.image if message.channels == "bgr" else message.image[:, :, ::-1].copy()
        try:
            return segment_frame(image, background, event_from_rgb, config, message.t_us, message.name, backend)
        except Exception as error:  # noqa: BLE001 -- whatever a frame does to a backend, the daemon lives on
            shell.problems = (f"{message.name}: {type(error).__name__}: {error}",)
            return Segmentation(message.t_us, message.name, failure=type(error).__name__, backend=backend.name)

    # Loop.
    while shell.running:
        bus.wait(WAIT_S, frames)
        message = frames.newest()
        if message is not None:
            result = segment(message)
            segmentations.put(SegmentationMessage.from_segmentation(result, message.request_id))
            shell.t_us = message.t_us
            shell.counts["frames"] += 1
            shell.counts["failures"] += int(bool(result.failure))
            if result.failure:
                shell.counts[f"failure {result.failure}"] += 1
            shell.latency("segment", int(result.elapsed_ms * 1e6))
        shell.tick({"backend": backend.name}, {}, now=message is not None)


def main() -> int:
    """Entry point of ``motiondlo-segmenter``."""
    return run_daemon("segmenter", serve)


if __name__ == "__main__":
    sys.exit(main())
