"""Masks of single DLOs, where a segmenter tells them apart: each is thinned by itself, so that crossings need no guess.

Past the paper, which thins the union of all masks and pairs the branches at every crossing.
"""

from __future__ import annotations

import numpy as np

from motiondlo.frames.mask_cleaning import adaptive_closing, clean_mask
from motiondlo.frames.masks import Mask, MaskSet, fit_mask
from motiondlo.frames.params import CleaningParams

_INSIDE = 0.85
"""Share of a mask's pixels from which it counts as covered by others, or as lying in another one."""


def single_masks(masks: MaskSet, shape: tuple[int, int], params: CleaningParams) -> list[Mask]:
    """Cleaned masks of single DLOs, (h, w) = ``shape`` uint8 0/1; none when the segmenter gave fewer than two.

    A mask that two or more others make up together holds several DLOs, and is left out.
    """
    if len(masks.masks) < 2:
        return []
    fitted = [fit_mask(candidate.mask, shape) for candidate in masks.masks]
    single = [mask for k, mask in enumerate(fitted) if not is_made_up(mask, fitted[:k] + fitted[k + 1 :])]
    cleaned = [adaptive_closing(clean_mask(mask, params), params) for mask in single]
    return [mask for mask in cleaned if mask.any()]


def is_made_up(mask: Mask, others: list[Mask]) -> bool:
    """Whether two or more smaller masks that lie in this one cover it."""
    area = int(np.count_nonzero(mask))
    parts = []
    for other in others:
        size = int(np.count_nonzero(other))
        if 0 < size < _INSIDE * area and int(np.count_nonzero(other & mask)) >= _INSIDE * size:
            parts.append(other)
    if len(parts) < 2:
        return False
    return int(np.count_nonzero(np.bitwise_or.reduce(parts) & mask)) >= _INSIDE * area
