"""Backend that reads masks from files: results of another segmenter, or drawn by hand."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np

from motiondlo.errors import ConfigError
from motiondlo.frames.masks import MaskSet, ScoredMask
from motiondlo.recording.layout import Image


class ReplayBackend:
    """Masks of frame ``frame_000001.jpg``: ``FOLDER/frame_000001.png``, or every PNG in ``FOLDER/frame_000001/``.

    Any grey level from 128 on belongs to the mask. A frame without files has no masks.
    """

    def __init__(self, folder: str) -> None:
        """Raises ConfigError when the folder does not exist."""
        self._folder = Path(folder)
        if not folder or not self._folder.is_dir():
            raise ConfigError(f"replay_folder {folder!r}: no such folder.", "Give the folder that holds the masks.")

    @property
    def name(self) -> str:
        """``replay``."""
        return "replay"

    def segment(self, image_bgr: Image, background: Image | None, frame_name: str) -> MaskSet:
        """Read the frame's masks; unreadable files and masks of another aspect ratio are left out."""
        stem = Path(frame_name).stem
        if not stem:
            return MaskSet()
        single = self._folder / f"{stem}.png"
        paths = [single] if single.is_file() else sorted((self._folder / stem).glob("*.png"))
        masks = []
        for path in paths:
            grey = cv2.imdecode(np.frombuffer(path.read_bytes(), np.uint8), cv2.IMREAD_GRAYSCALE)
            if grey is None or abs(grey.shape[1] * image_bgr.shape[0] - grey.shape[0] * image_bgr.shape[1]) > max(
                image_bgr.shape[:2]
            ):
                continue
            masks.append(ScoredMask(np.asarray(grey >= 128, dtype=np.uint8), 1.0))
        return MaskSet(tuple(masks))
