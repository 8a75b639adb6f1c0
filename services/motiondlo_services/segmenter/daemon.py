"""The segmenter's shell: frames in, segmentations out; one frame at a time, the newest first."""

from __future__ import annotations

import sys
from contextlib import ExitStack, suppress

import numpy as np

from motiondlo.bus.session import Bus
from motiondlo.config.cell import Cell
from motiondlo.frames.backend import SegmenterBackend, check_model, create_backend, runs_model
from motiondlo.frames.classical import ClassicalBackend
from motiondlo.messages.frame import FrameMessage
from motiondlo.messages.segmentation import SegmentationMessage
from motiondlo.topics import FRAME, SEGMENTATION
from motiondlo_services.runtime.shell import Shell, run_daemon
from motiondlo_services.segmenter.config import SegmenterConfig
from motiondlo_services.segmenter.core import SegmenterCore
from motiondlo_services.segmenter.withdrawals import Withdrawals
from motiondlo_services.segmenter.worker import WorkerBackend

WAIT_S = 0.2


def serve(shell: Shell, bus: Bus) -> None:
    """Segment until told to stop."""
    # Configuration and core; kernels are loaded before the first frame is accepted, a model in the background.
    config = shell.section(SegmenterConfig).resolved(shell.cell.path.parent)
    with ExitStack() as stack:
        job = _Job(shell, Withdrawals(bus.serve(("segment",))))
        backend = _backend(config, job, stack)
        background = shell.cell.background()
        event_from_rgb = shell.cell.event_map()
        if background is not None:
            warm = SegmenterCore(config, ClassicalBackend(config.foreground), event_from_rgb, background)
            warm.on_frame(background, -1, "warm-up")
        core = SegmenterCore(config, backend, event_from_rgb, background, frame_size=_frame_size(shell.cell))

        # Bus.
        frames = bus.subscriber(FRAME)
        segmentations = bus.publisher(SEGMENTATION)
        shell.ready()

        # Loop.
        with suppress(_Stopped):
            while shell.running:
                bus.wait(WAIT_S, frames)
                job.withdrawals.look()
                message = frames.newest()
                if message is not None:
                    shell.t_us = message.t_us
                    job.request_id = message.request_id
                    job.withdrawals.look()
                    if job.cancelled:
                        result = core.on_cancelled(message.t_us, message.name)
                    else:
                        result = core.on_frame(_bgr(message), message.t_us, message.name)
                    job.request_id = ""
                    segmentations.put(SegmentationMessage.from_segmentation(result, message.request_id))
                    shell.latency("segment", int(result.elapsed_ms * 1e6))
                    for stage, elapsed_ns in core.stages_ns.items():
                        shell.latency(stage, elapsed_ns)
                    shell.take_over(core.counts)
                    shell.problems = (core.problem,) if core.problem else ()
                    shell.lifecycle = "degraded" if core.degraded else "running"
                shell.tick(
                    {**_info(backend), "paused_until_us": core.retry_us},
                    core.rejects.as_dict(),
                    now=message is not None,
                )


class _Stopped(Exception):
    """The process was asked to stop while a frame was waited for."""


class _Job:
    """The frame at hand, and what is looked at while a worker has it."""

    def __init__(self, shell: Shell, withdrawals: Withdrawals) -> None:
        self._shell = shell
        self._told = ""
        self.withdrawals = withdrawals
        self.backend: WorkerBackend | None = None
        self.request_id = ""

    @property
    def cancelled(self) -> bool:
        """Whether nobody needs the frame at hand any more."""
        return self.withdrawals.has(self.request_id)

    def pulse(self) -> None:
        """Heartbeat, and an end to work for nobody. Raises _Stopped."""
        if not self._shell.running:
            raise _Stopped
        self.withdrawals.look()
        if self.backend is None:
            return
        if self.cancelled and self._told != self.request_id:
            self._told = self.request_id
            self.backend.cancel()
        self._shell.tick(_info(self.backend), {})


def _backend(config: SegmenterConfig, job: _Job, stack: ExitStack) -> SegmenterBackend:
    """The backend in this process, or in one of its own where it runs a model."""
    if not runs_model(config.backend):
        return create_backend(config)
    check_model(config)
    backend = job.backend = WorkerBackend(config, job.pulse)
    stack.callback(backend.stop)
    return backend


def _frame_size(cell: Cell) -> tuple[int, int] | None:
    recording = cell.recording()
    size = None if recording is None else recording.camera_info.rgb
    return None if size is None else (size.width, size.height)


def _info(backend: SegmenterBackend) -> dict[str, bool | int | float | str]:
    if isinstance(backend, WorkerBackend):
        return {"backend": backend.name, "model": backend.poll().value, "model_restarts": backend.restarts}
    return {"backend": backend.name}


def _bgr(message: FrameMessage) -> np.ndarray[tuple[int, ...], np.dtype[np.uint8]]:
    return message.image if message.channels == "bgr" else np.ascontiguousarray(message.image[:, :, ::-1])


def main() -> int:
    """Entry point of ``motiondlo-segmenter``."""
    return run_daemon("segmenter", serve)


if __name__ == "__main__":
    sys.exit(main())
