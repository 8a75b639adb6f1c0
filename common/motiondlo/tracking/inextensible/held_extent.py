"""How far a held DLO goes on beyond the end that the frame branch gave it.

Where the frame shows something else between the DLO's end and the jaws, that end is the DLO's own. Where the jaws begin
at once, it goes on under them, nobody knows how far; they stand higher than the DLO, so that the event camera sees them
elsewhere, and by their motion they uncover it or cover it up. Its silhouettes make events as far as it is uncovered.
"""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from motiondlo.frames.types import Appearance, FloatArray
from motiondlo.tracking.inextensible.held_kernels import (
    BEYOND_PX,
    NOT_SEEN_PX,
    PLACES,
    STEP_PX,
    silhouette_ends,
)
from motiondlo.tracking.inextensible.params import InextensibleParams

_NEAREST_JAW_PX, _FURTHEST_JAW_PX = 4.0, 36.0
_JAW_STEP = 0.12
"""Log-luminance of the jaws' edge in the frame."""
_SAME_PLACE_PX = 3.0
_AHEAD_PX = 6.0
"""Silhouettes beyond an end that the frame shows must go on this far before they are believed."""
_UNCOVERED_PX = 12.0
_NEW_LOOKS = 8
_AGREEING = 4
_LOOKED_FROM_PX = -24.0


def stands_clear(appearance: Appearance | None, index: int, length_px: float, radius_px: float) -> bool:
    """Whether the frame shows a gap between end ``index`` of a DLO and the jaws: a second edge across its whole width.

    length_px: of the shape that the appearance belongs to.
    """
    if appearance is None:
        return False
    strip = appearance.strip.astype(np.float64)
    rows, columns = strip.shape
    at = appearance.s0_px + appearance.ds_px * np.arange(rows)
    outward = -at if index == 0 else at - length_px
    d = (np.arange(columns) - (columns - 1) / 2.0) * appearance.dn_px
    places = np.arange(_NEAREST_JAW_PX, _FURTHEST_JAW_PX + 1.0)
    if float(outward.max()) < _FURTHEST_JAW_PX + 4.0:
        return False
    order = np.argsort(outward)
    steps = []
    for side in (-1.0, 1.0):
        part = (side * d > 0.2 * radius_px) & (side * d < 0.8 * radius_px)
        level = np.median(strip[:, part], axis=1)[order]
        beyond, before = (np.interp(places + shift, outward[order], level) for shift in (2.0, -2.0))
        steps.append(beyond - before)
    for k in np.flatnonzero(np.abs(steps[0]) > _JAW_STEP):
        near = np.abs(places - places[k]) <= _SAME_PLACE_PX
        if float((np.sign(steps[0][k]) * steps[1][near]).max()) > _JAW_STEP:
            return True
    return False


class HeldExtent:
    """One held end: how far outward of its first place, px, the DLO exists."""

    def __init__(self, clear: bool, params: InextensibleParams) -> None:
        """clear: the frame shows the DLO's own end (:func:`stands_clear`)."""
        self._params = params
        self._clear = clear
        self.beyond_px = 0.0 if clear else params.held_report_px
        self.presence: FloatArray = np.zeros((2, PLACES))
        self.looks: npt.NDArray[np.int64] = np.zeros(PLACES, np.int64)
        self._inner = int((BEYOND_PX + _LOOKED_FROM_PX) / STEP_PX)
        self._first_jaws_px = math.nan
        self._seen_px: list[float] = []
        self._jaws_px = 0.0
        self._looked = 0
        self._judged = 0
        self._ends = np.zeros(2)

    def judge(self, jaws_px: float) -> None:
        """Take from ``presence`` how far the DLO goes; jaws_px: how far its jaws have moved outward by parallax."""
        p = self._params
        looks = int(self.looks[self._inner :].min())
        # As slow as what it is compared with.
        self._jaws_px += (1.0 - (1.0 - p.presence_rate) ** (looks - self._looked)) * (jaws_px - self._jaws_px)
        self._looked = looks
        if looks < max(p.presence_looks, self._judged + _NEW_LOOKS):
            return
        self._judged = looks
        silhouette_ends(self.presence, p.presence_share, self._ends)
        ends = self._ends[self._ends < NOT_SEEN_PX]
        if not len(ends):
            return
        # Outward is positive from here on; jaws beside the DLO hide either silhouette early.
        self._seen_px.append(-float(ends.max()))
        del self._seen_px[:-_AGREEING]
        if len(self._seen_px) < 2:
            return
        if math.isnan(self._first_jaws_px):
            self._first_jaws_px = self._jaws_px
        # What was seen once is there, though it may be covered up later.
        sure_px = min(self._seen_px)
        if len(self._seen_px) == _AGREEING and sure_px > self.beyond_px + (_AHEAD_PX if self._clear else 0.0):
            self.beyond_px = min(sure_px + p.presence_margin_px, p.held_reach_px)
            return
        # Jaws that have moved away and uncovered nothing more: there it ends.
        furthest_px = -float(ends.min())
        if self._jaws_px - self._first_jaws_px > _UNCOVERED_PX and max(furthest_px, 0.0) < self.beyond_px:
            self.beyond_px = max(furthest_px, 0.0)
