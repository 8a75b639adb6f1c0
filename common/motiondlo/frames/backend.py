"""What a segmenter backend is: an image in, masks of DLOs out. Backends are chosen by name."""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol

import numpy as np
import numpy.typing as npt

from motiondlo.errors import ConfigError
from motiondlo.frames.classical import ClassicalBackend
from motiondlo.frames.masks import MaskSet
from motiondlo.frames.params import FrameParams
from motiondlo.frames.replay import ReplayBackend

Image = npt.NDArray[np.uint8]


class SegmenterBackend(Protocol):
    """Finds the pixels of DLOs in one image; holds models and caches, but no state between frames."""

    @property
    def name(self) -> str:
        """Name that configuration and results show."""
        ...

    def segment(self, image_bgr: Image, background: Image | None, frame_name: str) -> MaskSet:
        """Masks of DLOs: one per instance, or one foreground with all of them; empty when nothing is found."""
        ...


_FACTORIES: dict[str, Callable[[FrameParams], SegmenterBackend]] = {
    "classical": lambda params: ClassicalBackend(params.foreground),
    "replay": lambda params: ReplayBackend(params.replay_folder),
}


def backend_names() -> tuple[str, ...]:
    """Names that ``create_backend`` knows."""
    return tuple(sorted(_FACTORIES))


def create_backend(params: FrameParams) -> SegmenterBackend:
    """The backend that ``params.backend`` names. Raises ConfigError for an unknown name, naming the known ones."""
    factory = _FACTORIES.get(params.backend)
    if factory is None:
        raise ConfigError(
            f"segmenter backend {params.backend!r} is unknown.", f"Choose one of: {', '.join(backend_names())}."
        )
    return factory(params)
