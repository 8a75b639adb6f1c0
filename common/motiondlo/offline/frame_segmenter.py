"""Segment frames of a recording on demand; nothing is kept on disk."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from motiondlo.config.validation import validated
from motiondlo.frames.backend import create_backend
from motiondlo.frames.params import FrameParams
from motiondlo.frames.pipeline import segment_frame
from motiondlo.frames.types import Segmentation
from motiondlo.geometry.camera_map import CameraMap
from motiondlo.geometry.lens import LensModel
from motiondlo.recording.layout import FrameEntry, Recording, read_image
from motiondlo.rejects import RejectReason


class FrameSegmenter:
    """The frame branch over one recording: homography, empty board and backend are read once, before the start."""

    def __init__(
        self,
        recording: Recording,
        overrides: Mapping[str, Any],
        rgb_lens: LensModel | None = None,
        event_lens: LensModel | None = None,
    ) -> None:
        """Raises CalibrationError for an unusable homography, ConfigError for a wrong parameter."""
        matrix = recording.event_from_rgb()
        no_lens = rgb_lens is None and event_lens is None
        self._event_from_rgb = matrix if no_lens else CameraMap(matrix, rgb_lens, event_lens)
        self._background = recording.background()
        self._params = validated(FrameParams, overrides, "frames")
        self._backend = create_backend(self._params)

    def segment(self, entry: FrameEntry) -> Segmentation:
        """The DLOs of one frame; an unreadable picture is a failed segmentation, as in a live cell."""
        image = read_image(entry.path)
        if image is None:
            return Segmentation(
                entry.t_us, entry.name, failure=RejectReason.FRAME_UNREADABLE.value, backend=self._backend.name
            )
        return segment_frame(
            image, self._background, self._event_from_rgb, self._params, entry.t_us, entry.name, backend=self._backend
        )
