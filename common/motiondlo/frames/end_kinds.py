"""Why a DLO stops where it stops: border, gripper, something that hides it, or its own tip."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from numpy.lib.stride_tricks import sliding_window_view

from motiondlo.frames.covers import Band, Cover
from motiondlo.frames.strip import Scene, sample_strip
from motiondlo.frames.types import EndKind
from motiondlo.geometry.curve import project

FloatArray = npt.NDArray[np.float64]

_CHANGED = 0.12
"""Relative difference from the board that an object ahead shows (the strongest cast shadows are excluded by width)."""
_HELD_SHARE = 0.45
_STEP_CODES = 9.0
_LEAST_SCALE_PX = 12.0
"""Beside a thinner DLO the board's own texture has steps."""
_BESIDE_W = 0.35
_OBLIQUE_W = 1.5
"""How far ahead or behind, in widths, an oblique edge may cross either side."""
_CROOKED_W = 0.6
_GAP = 3
"""Samples around a step that are left out: its soft edge, and thin lines."""


@dataclass(frozen=True)
class EndView:
    """An end and its surroundings."""

    point: FloatArray
    """(2,) image px."""
    outward: FloatArray
    """(2,) unit tangent."""
    width: float
    found: bool
    at_border: bool


def classify_end(scene: Scene, view: EndView, others: list[Band], bands: Cover | None = None) -> EndKind:
    """Kind of an end. others: every other DLO piece; bands: their area."""
    width, height = scene.size
    x, y = view.point + view.outward * 0.5 * view.width
    if view.at_border or x < 0 or y < 0 or x > width - 1 or y > height - 1:
        return EndKind.BORDER
    if object_ahead(scene, view, bands) > _HELD_SHARE:
        return EndKind.HELD
    beyond = (view.point + view.outward * 0.3 * view.width)[None]
    for centre, other_width in others:
        if float(project(beyond, centre)[0][0]) < 0.5 * other_width + _BESIDE_W * view.width:
            return EndKind.HIDDEN
    if edge_across(scene, view) > _STEP_CODES:
        return EndKind.HIDDEN
    return EndKind.TIP if view.found else EndKind.UNKNOWN


def object_ahead(scene: Scene, view: EndView, bands: Cover | None = None) -> float:
    """Share of a field ahead of the end, wider than the DLO, that is neither the empty board nor another DLO.

    The field starts past the end and is 2.6 widths wide and 2.5 long: a tip's own shadow fills a small part of it, a
    gripper most of it. bands: the other DLOs.
    """
    reach = np.arange(0.3 * view.width, 2.8 * view.width, 1.5)
    centre = view.point + reach[:, None] * view.outward
    strip = sample_strip(scene, centre, 1.3 * view.width, 1.5)
    changed = np.abs(strip.ratio - 1.0).max(axis=2) > _CHANGED
    if bands is not None:
        changed &= ~bands.at(strip.places)
    return float(changed.mean())


def edge_across(scene: Scene, view: EndView) -> float:
    """Strength, image codes, of a lasting step of the surroundings at the end, on both sides of the DLO.

    Where a DLO runs under a plate, the plate's edge goes on to the left and right of it; at a free tip nothing does.
    The weaker side counts. Thin printed lines are no steps: both sides of them look the same.
    """
    _, steps = _lasting_steps(scene, view, 1.8, 0.8)
    if not steps:
        return 0.0
    strongest = [step[int(np.abs(step).max(axis=1).argmax())] for step in steps]
    weaker = min(np.abs(strongest[0]).max(), np.abs(strongest[1]).max())
    return float(weaker) if float(strongest[0] @ strongest[1]) > 0.0 else 0.0


def may_be_hidden(scene: Scene, view: EndView) -> bool:
    """Whether an edge that may cross the DLO obliquely goes through the end: a weaker sign than :func:`edge_across`."""
    along, steps = _lasting_steps(scene, view, 2.5, _OBLIQUE_W)
    if not steps:
        return False
    sides = [np.abs(step).max(axis=1) for step in steps]
    # A straight edge through the end crosses one side as far ahead as it crosses the other side behind.
    one_edge = np.abs(along[:, None] + along[None]) <= _CROOKED_W * max(view.width, _LEAST_SCALE_PX)
    alike = steps[0] @ steps[1].T > 0.0
    return bool((one_edge & alike & (np.minimum(sides[0][:, None], sides[1][None]) > _STEP_CODES)).any())


def _lasting_steps(scene: Scene, view: EndView, half_w: float, reach_w: float) -> tuple[FloatArray, list[FloatArray]]:
    """Steps of the surroundings along either side of the DLO at an end, up to ``reach_w`` widths from it.

    Looks ``half_w`` widths ahead and back. Returns places (k,) px along, and a (k, 3) step for either side; no steps if
    there is no room for them.
    """
    width = max(view.width, _LEAST_SCALE_PX)
    along = np.arange(-half_w * width, half_w * width, 1.0)
    centre = view.point + along[:, None] * view.outward
    strip = sample_strip(scene, centre, 1.05 * width, 1.0)
    steps: list[FloatArray] = []
    for sign in (-1.0, 1.0):
        lateral = strip.offsets * sign
        band = (lateral > 0.72 * width) & (lateral < 1.0 * width)
        profile = strip.image[:, band].mean(axis=1).astype(np.float64)
        span = min(max(int(0.5 * width), 5), (len(profile) - 2 * _GAP) // 2 - 1)
        if span < 2:
            return along, []
        level = np.median(sliding_window_view(profile, span, axis=0), axis=2)
        # level[k] covers samples k to k + span; the step at m compares the windows before m - gap and after m + gap.
        middle = np.arange(span + _GAP, len(profile) - span - _GAP)
        middle = middle[np.abs(along[middle]) <= reach_w * width]
        if len(middle) == 0:
            return along, []
        steps.append(level[middle + _GAP] - level[middle - _GAP - span])
    return along[middle], steps
