"""Backend ``sam3``: text prompts in, one mask per DLO out (paper, "SAM 3 Segmentation")."""

from __future__ import annotations

from time import perf_counter_ns

import numpy as np

from motiondlo.frames.backend_params import Sam3Params
from motiondlo.frames.candidates import harden, keep_candidates, surest, working_shape
from motiondlo.frames.masks import MaskSet, ScoredMask
from motiondlo.frames.sam3_model import Image, ModelTimes, Sam3Network, SoftMask, load_network


class Sam3Backend:
    """SAM 3 with its prompts; the model is loaded when this is made."""

    def __init__(self, params: Sam3Params, work_width_px: int, network: Sam3Network | None = None) -> None:
        """``network``: one that is loaded already. Raises ConfigError as ``load_network`` does."""
        self._params = params
        self._work_width_px = work_width_px
        self._network = network if network is not None else load_network(params)

    @property
    def name(self) -> str:
        """``sam3``."""
        return "sam3"

    @property
    def runs_on(self) -> str:
        """Device, number type and size, for people."""
        return self._network.runs_on

    def segment(self, image_bgr: Image, background: Image | None, frame_name: str) -> MaskSet:
        """Masks at working size, the largest first, each with its score; duplicates between prompts are gone."""
        times = ModelTimes()
        found = self._network.find(image_bgr, lambda scores: surest(scores, self._params.candidates), times)
        began_ns = perf_counter_ns()
        masks = self._kept(found, working_shape(image_bgr.shape, self._work_width_px))
        times.ns["candidates"] = perf_counter_ns() - began_ns
        return MaskSet(masks, stages_ns=times.ns)

    def _kept(self, found: list[SoftMask], shape: tuple[int, int]) -> tuple[ScoredMask, ...]:
        candidates = self._params.candidates
        # Every prompt had its best ones; now the best of all.
        best = [found[k] for k in surest(np.array([soft.score for soft in found], np.float32), candidates)]
        masks = tuple(
            ScoredMask(harden(soft.probability, shape, candidates.mask_threshold), soft.score) for soft in best
        )
        return keep_candidates(masks, candidates)
