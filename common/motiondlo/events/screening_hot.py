"""Hot pixels: found from what the buckets hold anyway, a few tiles at a time, so that no event pays for it."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from motiondlo.events.screening_kernels import HOT, judge_tile
from motiondlo.events.screening_params import ScreeningParams

_ROUND_BATCHES = 100
"""So many batches go by between two judgements of a tile."""
_WINDOW_US = 200_000
_LEAST = 12
_PATIENCE = 2
_RELEASE_US = 20_000_000
"""A pixel that is left out makes no events that could clear it: it is tried again after this."""


class HotPixelFinder:
    """Marks pixels with the bit HOT in a mask of the sensor."""

    def __init__(self, params: ScreeningParams, tiles: int) -> None:
        self.params = params
        self.count = 0
        self._next_tile = 0
        self._heads = np.zeros(tiles, np.int64)
        self._suspects: dict[int, int] = {}
        self._released_us = 0
        self._score = np.zeros(256, np.uint16)
        self._found = np.zeros(16, np.int64)

    def look(
        self,
        t_us: int,
        rings: npt.NDArray[np.int64],
        heads: npt.NDArray[np.int64],
        busy: npt.NDArray[np.bool_],
        mask: npt.NDArray[np.uint8],
    ) -> bool:
        """Judge the next few tiles; busy: (tiles,) those that a moving DLO touches. Whether the mask has changed."""
        tiles = len(heads)
        first = self._next_tile
        last = min(first + -(-tiles // _ROUND_BATCHES), tiles)
        self._next_tile = 0 if last == tiles else last
        changed = self._release(t_us, mask)
        due = np.flatnonzero((heads[first:last] - self._heads[first:last] >= _LEAST) & ~busy[first:last]) + first
        self._heads[first:last] = heads[first:last]
        for tile in due.tolist():
            n = judge_tile(
                rings[tile], heads[tile], t_us - _WINDOW_US, t_us, self.params.hot_hz, self.params.hot_ratio, _LEAST,
                self._score, self._found,
            )  # fmt: skip
            for place in self._found[:n].tolist():
                changed |= self._suspect(place, mask)
        return changed

    def _suspect(self, place: int, mask: npt.NDArray[np.uint8]) -> bool:
        votes = self._suspects.get(place, 0) + 1
        if votes < _PATIENCE:
            if len(self._suspects) > 4 * self.params.hot_limit:
                self._suspects.clear()
            self._suspects[place] = votes
            return False
        self._suspects.pop(place, None)
        if self.count >= self.params.hot_limit:
            return False
        mask[place >> 11, place & 0x7FF] |= HOT
        self.count += 1
        return True

    def _release(self, t_us: int, mask: npt.NDArray[np.uint8]) -> bool:
        if t_us - self._released_us < _RELEASE_US:
            return False
        self._released_us = t_us
        self._suspects.clear()
        if not self.count:
            return False
        mask &= 0xFF ^ HOT
        self.count = 0
        return True
