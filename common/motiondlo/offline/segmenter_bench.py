"""Time of a segmenter backend and of the frame branch around it, per stage, on one picture."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from time import perf_counter
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from motiondlo.errors import ConfigError, RecordingError
from motiondlo.frames.backend import SegmenterBackend, create_backend
from motiondlo.frames.params import FrameParams
from motiondlo.frames.pipeline import StageTimes, segment_frame
from motiondlo.frames.sam3_backend import Sam3Backend
from motiondlo.frames.sam3_random import Size, random_network
from motiondlo.frames.sam3_weights import HOW_TO_INSTALL, missing_packages
from motiondlo.frames.types import Segmentation
from motiondlo.offline.progress import Progress
from motiondlo.recording.layout import open_recording, read_image

Image = npt.NDArray[np.uint8]


@dataclass
class BackendTiming:
    """What was measured."""

    backend: str
    runs_on: str
    load_s: float
    image_px: tuple[int, int]
    """Width and height."""
    outcome: str
    first_ms: float
    """The first frame compiles kernels and fills caches."""
    total_ms: list[float] = field(default_factory=list)
    stages_ms: dict[str, list[float]] = field(default_factory=dict)

    def as_json(self) -> dict[str, Any]:
        """``total_ms`` and every stage as p50 and max."""
        return {
            "backend": self.backend,
            "runs_on": self.runs_on,
            "load_s": round(self.load_s, 3),
            "image_px": list(self.image_px),
            "outcome": self.outcome,
            "first_ms": round(self.first_ms, 3),
            "total_ms": _quantiles(self.total_ms),
            "stages_ms": {name: _quantiles(values) for name, values in self.stages_ms.items()},
        }


def picture(path: Path, width_px: int | None) -> tuple[Image, Image | None]:
    """A picture, or a recording's first frame with its empty board, brought to a width. Raises RecordingError."""
    background = None
    if path.is_dir():
        recording = open_recording(path)
        if not recording.frames:
            raise RecordingError(f"{path}: has no frames.", "Give a picture, or a recording with frames.")
        image, background = read_image(recording.frames[0].path), recording.background()
    else:
        image = read_image(path)
    if image is None:
        raise RecordingError(f"{path}: no readable picture.", "Give a picture, or a recording with frames.")
    if width_px is None:
        return image, background
    return _resized(image, width_px), None if background is None else _resized(background, width_px)


def time_backend(
    params: FrameParams,
    image: Image,
    background: Image | None,
    repeats: int,
    random_weights: Size | None,
    progress: Progress,
) -> BackendTiming:
    """Load the backend, then segment the picture ``1 + repeats`` times.

    random_weights: SAM 3 of that size without a download. Raises ConfigError for whatever the backend lacks.
    """
    began_s = perf_counter()
    backend, runs_on = _backend(params, random_weights)
    load_s = perf_counter() - began_s
    first, _ = _run(params, backend, image, background)
    outcome = first.failure or f"{len(first.instances)} instances"
    height, width = image.shape[:2]
    timing = BackendTiming(backend.name, runs_on, load_s, (width, height), outcome, first.elapsed_ms)
    for k in range(repeats):
        result, times = _run(params, backend, image, background)
        timing.total_ms.append(result.elapsed_ms)
        for name, ns in times.ns.items():
            timing.stages_ms.setdefault(name, []).append(ns / 1e6)
        progress((k + 1) / repeats)
    return timing


def _run(
    params: FrameParams, backend: SegmenterBackend, image: Image, background: Image | None
) -> tuple[Segmentation, StageTimes]:
    times = StageTimes()
    return segment_frame(image, background, None, params, 0, "frame_000001.jpg", backend, times), times


def _backend(params: FrameParams, random_weights: Size | None) -> tuple[SegmenterBackend, str]:
    if random_weights is None:
        backend = create_backend(params)
    elif params.backend != "sam3":
        raise ConfigError(f"backend {params.backend!r} has no random weights.", "Give --backend sam3.")
    elif missing_packages():
        raise ConfigError(f"backend sam3 needs {', '.join(missing_packages())}.", HOW_TO_INSTALL)
    else:
        width_px = params.foreground.work_width_px
        backend = Sam3Backend(params.sam3, width_px, random_network(params.sam3, random_weights))
    return backend, backend.runs_on if isinstance(backend, Sam3Backend) else "cpu"


def _resized(image: Image, width_px: int) -> Image:
    height_px = round(image.shape[0] * width_px / image.shape[1])
    shrinks = width_px < image.shape[1]
    interpolation = cv2.INTER_AREA if shrinks else cv2.INTER_CUBIC
    return np.asarray(cv2.resize(image, (width_px, height_px), interpolation=interpolation), dtype=np.uint8)


def _quantiles(values: list[float]) -> dict[str, float]:
    return {"p50": round(float(np.median(values)), 3), "max": round(max(values), 3)}
