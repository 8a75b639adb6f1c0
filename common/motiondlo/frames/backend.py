"""What a segmenter backend is: an image in, masks of DLOs out. Backends are chosen by name."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import numpy as np
import numpy.typing as npt

from motiondlo.errors import ConfigError
from motiondlo.frames.checks import FrameFailure
from motiondlo.frames.classical import ClassicalBackend
from motiondlo.frames.masks import MaskSet
from motiondlo.frames.onnx_backend import OnnxBackend, check_onnx
from motiondlo.frames.params import FrameParams
from motiondlo.frames.replay import ReplayBackend
from motiondlo.frames.sam3_backend import Sam3Backend
from motiondlo.frames.sam3_weights import check_sam3

Image = npt.NDArray[np.uint8]


class SegmenterBackend(Protocol):
    """Finds the pixels of DLOs in one image; holds models and caches, but no state between frames."""

    @property
    def name(self) -> str:
        """Name that configuration and results show."""
        ...

    def segment(self, image_bgr: Image, background: Image | None, frame_name: str) -> MaskSet:
        """Masks of DLOs: one per instance, or one foreground with all of them; empty when nothing is found.

        Raises BackendUnavailable when it has a name for why it cannot; whatever else it raises counts as broken.
        """
        ...


class BackendUnavailable(Exception):
    """The backend has no answer for this frame, and knows why."""

    def __init__(self, failure: FrameFailure, what: str) -> None:
        super().__init__(what)
        self.failure = failure


@dataclass(frozen=True)
class _Row:
    make: Callable[[FrameParams], SegmenterBackend]
    check_model: Callable[[FrameParams], object] | None = None
    """For backends that run a model: whether package and files are there."""


_BACKENDS = {
    "classical": _Row(lambda params: ClassicalBackend(params.foreground)),
    "onnx": _Row(
        lambda params: OnnxBackend(params.onnx, params.foreground.work_width_px), lambda p: check_onnx(p.onnx)
    ),
    "replay": _Row(lambda params: ReplayBackend(params.replay_folder)),
    "sam3": _Row(
        lambda params: Sam3Backend(params.sam3, params.foreground.work_width_px), lambda p: check_sam3(p.sam3)
    ),
}


def backend_names() -> tuple[str, ...]:
    """Names that ``create_backend`` knows."""
    return tuple(sorted(_BACKENDS))


def runs_model(name: str) -> bool:
    """Whether a backend loads a model for seconds and may hang in it: a daemon gives it a process of its own."""
    return name in _BACKENDS and _BACKENDS[name].check_model is not None


def check_model(params: FrameParams) -> None:
    """Look, without loading anything, for what the backend's model needs. Raises ConfigError for what is missing."""
    check = _BACKENDS[params.backend].check_model if params.backend in _BACKENDS else None
    if check is not None:
        check(params)


def create_backend(params: FrameParams) -> SegmenterBackend:
    """The backend that ``params.backend`` names, its model loaded.

    Raises ConfigError for an unknown name, naming the known ones, and for whatever the backend lacks (package, weights,
    accelerator).
    """
    row = _BACKENDS.get(params.backend)
    if row is None:
        raise ConfigError(
            f"segmenter backend {params.backend!r} is unknown.", f"Choose one of: {', '.join(backend_names())}."
        )
    return row.make(params)
