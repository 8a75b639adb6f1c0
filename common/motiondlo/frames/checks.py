"""Frames that cannot be segmented at all, told before any work is spent on them."""

from __future__ import annotations

from enum import StrEnum

import numpy as np

from motiondlo.frames.colour import Image
from motiondlo.frames.params import CheckParams


class FrameFailure(StrEnum):
    """Why a frame gave no instances; the value is what the segmentation message shows."""

    WRONG_SIZE = "wrong_size"
    """Not (H, W, 3) uint8, too small, or another size than the background plate."""
    BLACK = "black"
    SATURATED = "saturated"
    CUT_SHORT = "cut_short"
    """The lower part of the picture never arrived: the decoder or the driver filled it with one colour."""
    BLURRED = "blurred"
    """Every DLO that was found had edges smeared by motion (or the camera is out of focus)."""
    NOTHING_FOUND = "nothing_found"
    """A good picture without a DLO. A failure, so that nobody takes it for the news that a DLO is gone."""
    BACKEND_FAILED = "backend_failed"
    STILL_LOADING = "still_loading"
    """The backend's model is not there yet; frames are answered all the same."""
    TIMED_OUT = "timed_out"
    """The backend took longer than its limit."""
    CANCELLED = "cancelled"
    """Nobody needs it any more: its DLOs move again."""


_MIN_SIDE_PX = 64


def check_frame(image_bgr: Image, background: Image | None, params: CheckParams) -> FrameFailure | None:
    """The reason to refuse a frame, or None."""
    if image_bgr.ndim != 3 or image_bgr.shape[2] != 3 or image_bgr.dtype != np.uint8:
        return FrameFailure.WRONG_SIZE
    if min(image_bgr.shape[:2]) < _MIN_SIDE_PX:
        return FrameFailure.WRONG_SIZE
    if background is not None and background.shape != image_bgr.shape:
        return FrameFailure.WRONG_SIZE
    sample = image_bgr[::8, ::8]
    if float((sample.max(axis=2) <= params.dark_level).mean()) > params.max_dark_share:
        return FrameFailure.BLACK
    if float((sample.min(axis=2) >= params.bright_level).mean()) > params.max_bright_share:
        return FrameFailure.SATURATED
    if flat_rows(image_bgr) > params.max_flat_share * image_bgr.shape[0]:
        return FrameFailure.CUT_SHORT
    return None


def flat_rows(image_bgr: Image) -> int:
    """Rows at the lower edge that have one single colour, where others show the noise of a sensor.

    0 where rows farther up are just as flat (a drawn picture), and where the light saturates every pixel.
    """
    columns = image_bgr[:, ::16]
    colour = columns[-1, 0]
    if int(colour.min()) == 255:
        return 0
    differs = (columns != colour).any(axis=(1, 2))
    rows = int(np.argmax(differs[::-1])) if differs.any() else len(differs)
    above = columns[: len(columns) - rows]
    flat_above = int((above == above[:, :1]).all(axis=(1, 2)).sum()) if rows else 0
    return 0 if not len(above) or flat_above > 0.05 * len(above) else rows
