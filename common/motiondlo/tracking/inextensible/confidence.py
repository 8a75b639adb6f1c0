"""How likely the estimate of a DLO is right, from what the tracker knows without a truth.

A logistic function of few quantities. Its coefficients were fitted on simulated recordings in which tracking was made
to fail (wrong first shapes, 94 to 99.6 % of the events left out, parts of the image blind, outages, noise), "wrong"
being an error above 2 mm: fitted to half of the recordings, the area under the ROC curve is 0.90 and 0.93 on the other.
"""

from __future__ import annotations

import math

_FEW = -0.69
_FEW_STATIONS = 5.0
_SPREAD = -0.11
_UNSEEN_SHARE = -1.03
_UNEXPLAINED_AWAKE = -1.88
_UNEXPLAINED_AT_REST = -3.68
_CONSTANT = 3.24
_SHARE_MEMORY_MS = 50.0
_SMALLEST_SPREAD_PX = 0.2
_UNEXPLAINED_MEMORY_MS = 10.0
_BACKGROUND_PER_MS = 100.0


class Confidence:
    """Of one DLO."""

    def __init__(self) -> None:
        self._share = 1.0

    def advance(self, dt_ms: float, seen: int, could: int) -> None:
        """A step in which the DLO was awake: ``seen`` of the ``could`` stations in view were matched."""
        gain = 1.0 - math.exp(-dt_ms / _SHARE_MEMORY_MS)
        self._share += gain * (seen / max(could, 1) - self._share)

    def value(self, at_rest: bool, seen: int, spread_px: float, unexplained: float) -> float:
        """0..1; spread_px: median standard deviation across; unexplained: see :class:`UnexplainedEvents`."""
        logit = _CONSTANT + _SPREAD * math.log(max(spread_px, _SMALLEST_SPREAD_PX))
        logit += _UNSEEN_SHARE * (1.0 - self._share)
        if at_rest:
            # Something moves that is none of the DLOs where they are held to be.
            logit += _UNEXPLAINED_AT_REST * unexplained
        else:
            logit += _FEW * math.exp(-seen / _FEW_STATIONS) + _UNEXPLAINED_AWAKE * unexplained
        return 1.0 / (1.0 + math.exp(-logit))


class UnexplainedEvents:
    """Share of the scene's events that lie near no DLO, 0..1; a sensor's background alone leaves it near 0."""

    def __init__(self) -> None:
        self.share = 0.0

    def advance(self, span_ms: float, events: int, near: int) -> None:
        """A batch of ``events``, of which ``near`` lie near some DLO."""
        near_per_ms = near / span_ms
        far_per_ms = max(events - near, 0) / span_ms
        share = far_per_ms / (far_per_ms + near_per_ms + _BACKGROUND_PER_MS)
        self.share += (1.0 - math.exp(-span_ms / _UNEXPLAINED_MEMORY_MS)) * (share - self.share)
