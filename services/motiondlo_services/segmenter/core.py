"""Around the frame branch: what is counted, and when a broken backend is left alone. No I/O, no clock.

A frame without a DLO, or a bad picture, is an ordinary failure: the next frame is tried at once. A backend that raises
(out of memory, lost accelerator) is tried again after a pause that doubles, so that it is not hammered while it
recovers; so is one that ran out of time. While a model is loading, each frame is answered at once that it is.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from motiondlo.frames.backend import BackendUnavailable, SegmenterBackend
from motiondlo.frames.checks import FrameFailure
from motiondlo.frames.params import FrameParams
from motiondlo.frames.pipeline import StageTimes, segment_frame
from motiondlo.frames.types import Segmentation
from motiondlo.geometry.camera_map import CameraMap
from motiondlo.rejects import RejectCounter, RejectReason

Image = npt.NDArray[np.uint8]


@dataclass(frozen=True)
class BackoffPolicy:
    """Pauses after a backend raised, in event time."""

    first_us: int = 500_000
    longest_us: int = 30_000_000
    degraded_after: int = 3
    """So many failures of any kind in a row mean DEGRADED."""


class SegmenterCore:
    """Segments frames with one backend; never raises for a frame."""

    def __init__(
        self,
        params: FrameParams,
        backend: SegmenterBackend,
        event_from_rgb: npt.NDArray[np.float64] | CameraMap | None = None,
        background: Image | None = None,
        policy: BackoffPolicy | None = None,
        frame_size: tuple[int, int] | None = None,
    ) -> None:
        """event_from_rgb: (3, 3) float64 or None; background: (H, W, 3) uint8 BGR or None.

        frame_size: (width, height) that the homography was made for; frames of another one are refused. None: any.
        """
        self._params = params
        self._backend = backend
        self._event_from_rgb = event_from_rgb
        self._background = background
        self._frame_size = frame_size
        self._policy = policy if policy is not None else BackoffPolicy()
        self._broken_in_a_row = 0
        self._retry_us = -1
        self.failures_in_a_row = 0
        self.rejects = RejectCounter()
        self.counts: Counter[str] = Counter()
        self.stages_ns: dict[str, int] = {}
        self.problem = ""
        """What the backend said when it last raised; empty once it works again."""

    @property
    def degraded(self) -> bool:
        """Whether so many frames failed in a row that somebody should look."""
        return self.failures_in_a_row >= self._policy.degraded_after

    @property
    def retry_us(self) -> int:
        """Frames before this event time are not handed to the backend; -1: no pause."""
        return self._retry_us

    def on_cancelled(self, t_us: int, frame_name: str) -> Segmentation:
        """The answer for a frame that nobody needs any more; no failure of the backend's."""
        self.counts["cancelled"] += 1
        return self._broken(t_us, frame_name, FrameFailure.CANCELLED)

    def on_frame(self, image_bgr: Image, t_us: int, frame_name: str) -> Segmentation:
        """Segment one frame; a failure comes back as a Segmentation with its reason."""
        self.counts["frames"] += 1
        if 0 <= t_us < self._retry_us:
            self.counts["paused"] += 1
            return self._counted(self._broken(t_us, frame_name))
        if self._frame_size is not None and image_bgr.shape[1::-1] != self._frame_size:
            return self._counted(self._broken(t_us, frame_name, FrameFailure.WRONG_SIZE))
        times = StageTimes()
        try:
            result = segment_frame(
                image_bgr,
                self._background,
                self._event_from_rgb,
                self._params,
                t_us,
                frame_name,
                self._backend,
                times,
            )
        except BackendUnavailable as refusal:
            if refusal.failure is FrameFailure.CANCELLED:
                return self.on_cancelled(t_us, frame_name)
            self.problem = f"{frame_name}: {refusal}"
            if refusal.failure is not FrameFailure.STILL_LOADING:
                self._pause(t_us)
            return self._counted(self._broken(t_us, frame_name, refusal.failure))
        except Exception as error:  # noqa: BLE001 -- whatever a frame does to a backend, the segmenter lives on
            self.problem = f"{frame_name}: {type(error).__name__}: {error}"
            self._pause(t_us)
            return self._counted(self._broken(t_us, frame_name))
        self._broken_in_a_row = 0
        self._retry_us = -1
        self.problem = ""
        self.stages_ns = times.ns
        return self._counted(result)

    def _pause(self, t_us: int) -> None:
        self._broken_in_a_row += 1
        pause_us = min(self._policy.first_us << min(self._broken_in_a_row - 1, 20), self._policy.longest_us)
        self._retry_us = t_us + pause_us

    def _broken(self, t_us: int, frame_name: str, failure: FrameFailure = FrameFailure.BACKEND_FAILED) -> Segmentation:
        return Segmentation(t_us, frame_name, failure=failure.value, backend=self._backend.name)

    def _counted(self, result: Segmentation) -> Segmentation:
        if result.failure:
            self.failures_in_a_row += 1
            self.counts["failures"] += 1
            self.counts[f"failure {result.failure}"] += 1
            wrong_size = result.failure == FrameFailure.WRONG_SIZE.value
            self.rejects.count(RejectReason.FRAME_WRONG_SIZE if wrong_size else RejectReason.SEGMENTATION_FAILED)
        else:
            self.failures_in_a_row = 0
            self.counts["instances"] += len(result.instances)
        return result
