"""The segmenter's shell: frames in, segmentations out; one frame at a time, the newest first."""

from __future__ import annotations

import sys

import numpy as np

from motiondlo.bus.session import Bus
from motiondlo.frames.backend import create_backend
from motiondlo.messages.frame import FrameMessage
from motiondlo.messages.segmentation import SegmentationMessage
from motiondlo.topics import FRAME, SEGMENTATION
from motiondlo_services.runtime.shell import Shell, run_daemon
from motiondlo_services.segmenter.config import SegmenterConfig
from motiondlo_services.segmenter.core import SegmenterCore

WAIT_S = 0.2


def serve(shell: Shell, bus: Bus) -> None:
    """Segment until told to stop."""
    # Configuration and core; kernels are loaded before the first frame is accepted.
    config = shell.section(SegmenterConfig)
    backend = create_backend(config)
    background = shell.cell.background()
    event_from_rgb = shell.cell.event_from_rgb()
    if background is not None:
        SegmenterCore(config, backend, event_from_rgb, background).on_frame(background, -1, "warm-up")
    core = SegmenterCore(config, backend, event_from_rgb, background)

    # Bus.
    frames = bus.subscriber(FRAME)
    segmentations = bus.publisher(SEGMENTATION)
    shell.ready()

    # Loop.
    while shell.running:
        bus.wait(WAIT_S, frames)
        message = frames.newest()
        if message is not None:
            result = core.on_frame(_bgr(message), message.t_us, message.name)
            segmentations.put(SegmentationMessage.from_segmentation(result, message.request_id))
            shell.t_us = message.t_us
            shell.latency("segment", int(result.elapsed_ms * 1e6))
            shell.take_over(core.counts)
            shell.problems = (core.problem,) if core.problem else ()
            shell.lifecycle = "degraded" if core.degraded else "running"
        shell.tick({"backend": backend.name}, core.rejects.as_dict(), now=message is not None)


def _bgr(message: FrameMessage) -> np.ndarray[tuple[int, ...], np.dtype[np.uint8]]:
    return message.image if message.channels == "bgr" else np.ascontiguousarray(message.image[:, :, ::-1])


def main() -> int:
    """Entry point of ``motiondlo-segmenter``."""
    return run_daemon("segmenter", serve)


if __name__ == "__main__":
    sys.exit(main())
