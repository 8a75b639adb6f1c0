"""From a model's soft masks to the masks that are kept (paper, "SAM 3 Segmentation")."""

from __future__ import annotations

import cv2
import numpy as np
import numpy.typing as npt

from motiondlo.frames.backend_params import CandidateParams
from motiondlo.frames.board import working_scale
from motiondlo.frames.masks import ScoredMask, suppress_duplicates

FloatArray = npt.NDArray[np.float32]


def working_shape(image_shape: tuple[int, ...], work_width_px: int) -> tuple[int, int]:
    """(h, w) to which the frame branch shrinks an image of shape (H, W, ...): such masks are used as they are."""
    scale = working_scale(image_shape[1], work_width_px)
    return image_shape[0] // scale, image_shape[1] // scale


def surest(scores: FloatArray, params: CandidateParams) -> npt.NDArray[np.intp]:
    """Indices of the scores (N,) that are high enough, the best first, at most ``max_candidates``."""
    order = np.argsort(-scores, kind="stable")
    return np.asarray(order[scores[order] >= params.min_score][: params.max_candidates], dtype=np.intp)


def harden(probability: FloatArray, shape: tuple[int, int], threshold: float) -> npt.NDArray[np.uint8]:
    """(a, b) probabilities over the whole image -> (h, w) uint8 0/1, bilinear in between."""
    if probability.shape != shape:
        interpolation = cv2.INTER_AREA if probability.shape[0] > shape[0] else cv2.INTER_LINEAR
        probability = np.asarray(cv2.resize(probability, (shape[1], shape[0]), interpolation=interpolation))
    return np.asarray(probability >= threshold, dtype=np.uint8)


def keep_candidates(masks: tuple[ScoredMask, ...], params: CandidateParams) -> tuple[ScoredMask, ...]:
    """Drop small ones, then de-duplicate by intersection over union; the largest first, each a mask of its own."""
    if not masks:
        return ()
    min_area = int(np.ceil(params.min_area * masks[0].mask.size))
    return suppress_duplicates(masks, params.max_iou, min_area)


def sigmoid(logits: FloatArray) -> FloatArray:
    """Logistic function, without overflow."""
    return np.asarray(0.5 * (1.0 + np.tanh(0.5 * logits)), dtype=np.float32)
