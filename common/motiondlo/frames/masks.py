"""Masks that segmenter backends return, and their union (paper, "SAM 3 Segmentation")."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import cv2
import numpy as np
import numpy.typing as npt

Mask = npt.NDArray[np.uint8]
"""(h, w) uint8, 0 or 1."""


@dataclass(frozen=True)
class ScoredMask:
    """One candidate of a backend."""

    mask: Mask
    """(h, w) uint8 0/1, at the image's size or shrunk by a whole factor."""
    score: float
    """0..1, how sure the backend is."""


@dataclass(frozen=True)
class MaskSet:
    """All candidates of one image, all of the same size."""

    masks: tuple[ScoredMask, ...] = field(default_factory=tuple)
    obstacles: Mask | None = None
    """(h, w) uint8 0/1: things on the board that are no DLOs but may hold or hide one; None if the backend is blind
    to them."""
    stages_ns: Mapping[str, int] = field(default_factory=dict)
    """Host time per stage, where the backend measures it."""


def suppress_duplicates(masks: tuple[ScoredMask, ...], max_iou: float, min_area: int = 1) -> tuple[ScoredMask, ...]:
    """De-duplicate by intersection over union, larger masks first (paper, "SAM 3 Segmentation").

    A mask is suppressed when its IoU with an accepted one exceeds ``max_iou``; masks below ``min_area`` pixels are
    dropped. A suppressed mask's score survives in the accepted one if it is higher.
    """
    areas = {id(m): int(np.count_nonzero(m.mask)) for m in masks}
    accepted: list[ScoredMask] = []
    for candidate in sorted(masks, key=lambda m: -areas[id(m)]):
        if areas[id(candidate)] < max(1, min_area):
            continue
        for k, other in enumerate(accepted):
            both = int(np.count_nonzero(candidate.mask & other.mask))
            either = int(np.count_nonzero(candidate.mask | other.mask))
            if both > max_iou * either:
                accepted[k] = ScoredMask(other.mask, max(other.score, candidate.score))
                break
        else:
            accepted.append(candidate)
    return tuple(accepted)


def union(masks: tuple[ScoredMask, ...], shape: tuple[int, int]) -> Mask:
    """Pixel-wise union M_t of all masks, brought to ``shape`` (h, w). Returns (h, w) uint8 0/1."""
    merged = np.zeros(shape, np.uint8)
    for candidate in masks:
        np.maximum(merged, fit_mask(candidate.mask, shape), out=merged)
    return merged


def fit_mask(mask: Mask, shape: tuple[int, int]) -> Mask:
    """Bring a 0/1 mask to ``shape`` (h, w): shrunk by area (at least half covered), grown by nearest neighbour."""
    if mask.shape == shape:
        return mask
    if mask.shape[0] < shape[0]:
        grown = cv2.resize(mask, (shape[1], shape[0]), interpolation=cv2.INTER_NEAREST)
        return np.asarray(grown, dtype=np.uint8)
    scale = max(1, mask.shape[1] // shape[1])
    height, width = shape[0] * scale, shape[1] * scale
    whole = mask[:height, :width] if mask.shape[0] >= height and mask.shape[1] >= width else mask
    # 0/255 so that the byte arithmetic of the resize keeps the covered share.
    small = cv2.resize(np.asarray(whole * 255, np.uint8), (shape[1], shape[0]), interpolation=cv2.INTER_AREA)
    return np.asarray(small > 127, dtype=np.uint8)
