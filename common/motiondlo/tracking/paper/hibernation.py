"""Hibernation (paper, "Hibernation and Re-initialization").

"At each event batch, the fraction of active mask pixels is computed, rho = |M| / (H W). The DLO is considered static if
rho < rho_thr ... In this case, hibernation is leveraged by keeping the last generated polyline."
"""

from __future__ import annotations

from motiondlo.tracking.paper.params import PaperParams


class Hibernation:
    """The motion state of one DLO, with hysteresis in level (wake above, sleep below) and in time."""

    def __init__(self, params: PaperParams) -> None:
        self._params = params
        self._in_a_row = 0
        self.moving = False

    def update(self, rho: float) -> bool:
        """Take the active ratio of an update; returns whether the DLO moves. Without hibernation it always does."""
        p = self._params
        if not p.hibernation:
            self.moving = True
            return True
        against = rho < p.rho_sleep if self.moving else rho > p.rho_wake
        self._in_a_row = self._in_a_row + 1 if against else 0
        if self._in_a_row >= p.rho_updates:
            self.moving = not self.moving
            self._in_a_row = 0
        return self.moving
