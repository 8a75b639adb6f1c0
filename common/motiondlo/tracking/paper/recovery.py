"""The three re-initialisation triggers (paper, "Adaptive re-initialization").

"A drift-threshold trigger fires when the mean node-to-observation residual exceeds a limit ... A stuck-span trigger
fires when the bounding-box diagonal remains below a minimum extent across several consecutive frames ... The third
trigger detects stagnation when the noise variance remains saturated while node motion is minimal."
"""

from __future__ import annotations

from enum import StrEnum

import numpy as np
import numpy.typing as npt

from motiondlo.tracking.paper.params import PaperParams

FloatArray = npt.NDArray[np.float64]


class Trigger(StrEnum):
    """Why a track was started anew from the events."""

    DRIFT = "drift"
    STUCK_SPAN = "stuck_span"
    STAGNATION = "stagnation"


class RecoveryMonitor:
    """Watches one track; counts how often each trigger led to a new start."""

    # "Saturated" leaves room for rounding below sigma2_max.
    _SATURATED = 0.95

    def __init__(self, params: PaperParams) -> None:
        self._params = params
        self._small_updates = 0
        self.counts = dict.fromkeys(Trigger, 0)

    def check(self, nodes: FloatArray, residual_px: float, shift_px: float, sigma2_px2: float) -> Trigger | None:
        """The trigger that fires after an update, if any.

        nodes: (M, 2). residual_px: mean node-to-observation distance. shift_px: mean node motion of the update.
        """
        p = self._params
        span = float(np.hypot(*np.ptp(nodes, axis=0)))
        self._small_updates = self._small_updates + 1 if span < p.stuck_span_px else 0
        saturated = sigma2_px2 >= self._SATURATED * p.sigma2_max_px2
        fired: Trigger | None = None
        if p.reinit_on_drift and residual_px > p.drift_px:
            fired = Trigger.DRIFT
        elif p.reinit_on_stuck_span and self._small_updates >= p.stuck_updates:
            fired = Trigger.STUCK_SPAN
        elif (
            p.reinit_on_stagnation
            and saturated
            and shift_px < p.stagnation_shift_px
            and residual_px > p.stagnation_residual_px
        ):
            fired = Trigger.STAGNATION
        return fired

    def count(self, trigger: Trigger) -> None:
        """The track was started anew because of ``trigger``."""
        self._small_updates = 0
        self.counts[trigger] += 1
