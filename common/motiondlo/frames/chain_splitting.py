"""Chains that turn as no DLO does are two DLOs that met where the mask says nothing: they are taken apart there."""

from __future__ import annotations

import itertools

import numpy as np
import numpy.typing as npt

from motiondlo.frames.traversal import Chain
from motiondlo.geometry.curve import arc_length, point_at

FloatArray = npt.NDArray[np.float64]

_ARM_W = 1.0
"""Length of the two chords whose directions are compared, widths."""


def split_at_kinks(chain: Chain, max_turn_rad: float) -> list[Chain]:
    """Pieces of a chain between its kinks; the chain itself where there is none.

    A crossing that was cut out of the mask (too wide for a cable), or that has one pixel of skeleton, pairs branches
    of different DLOs. max_turn_rad: sharpest turn between two chords of a width each.
    """
    width = chain.width
    s = arc_length(chain.path)
    arm = max(_ARM_W * width, 4.0)
    if s[-1] < 3.0 * arm:
        return [chain]
    middle = np.arange(arm, s[-1] - arm, 1.0)
    before = point_at(chain.path, middle) - point_at(chain.path, middle - arm)
    after = point_at(chain.path, middle + arm) - point_at(chain.path, middle)
    cross = before[:, 0] * after[:, 1] - before[:, 1] * after[:, 0]
    turn = np.abs(np.arctan2(cross, (before * after).sum(axis=1)))
    cuts: list[float] = []
    while len(turn) and float(turn.max()) > max_turn_rad:
        at = float(middle[int(turn.argmax())])
        cuts.append(at)
        turn = np.where(np.abs(middle - at) < 2.0 * arm, 0.0, turn)
    if not cuts:
        return [chain]
    pieces = []
    bounds = [0.0, *sorted(cuts), float(s[-1])]
    for first, last in itertools.pairwise(bounds):
        part = (s >= first) & (s <= last)
        if int(part.sum()) >= 4:
            pieces.append(Chain(chain.path[part], chain.radius[part], chain.source))
    return pieces
