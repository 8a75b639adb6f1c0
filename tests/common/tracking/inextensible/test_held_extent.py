"""How far a held DLO is taken to go on: what the frame shows, and what its silhouettes and its jaws' motion add."""

from __future__ import annotations

import numpy as np
import pytest

from motiondlo.frames.types import Appearance
from motiondlo.tracking.inextensible.held_extent import HeldExtent, stands_clear
from motiondlo.tracking.inextensible.held_kernels import BEYOND_PX, PLACES, STEP_PX
from motiondlo.tracking.inextensible.params import InextensibleParams

PARAMS = InextensibleParams()
AT_PX = BEYOND_PX - np.arange(PLACES) * STEP_PX
"""Outward of the end, as presence has it."""


def frame_of(gap_px: float) -> Appearance:
    """A bright DLO of 200 px that ends at both ends of its shape, dark jaws ``gap_px`` further."""
    at = np.arange(-60.0, 261.0, 2.0)
    outward = np.maximum(-at, at - 200.0)
    level = np.where(outward < 0.0, -0.3, np.where(outward < gap_px, -1.0, -1.8))
    strip = np.repeat(level[:, None], 61, axis=1).astype(np.float32)
    return Appearance(strip, np.ones(strip.shape, np.uint8), -60.0)


@pytest.mark.parametrize("index", [0, 1])
def test_a_gap_before_the_jaws_is_an_end_of_its_own(index: int) -> None:
    assert stands_clear(frame_of(14.0), index, 200.0, 12.0)
    assert not stands_clear(frame_of(0.0), index, 200.0, 12.0)
    assert not stands_clear(None, index, 200.0, 12.0)


def test_a_screw_on_one_side_is_no_jaw() -> None:
    look = frame_of(0.0)
    look.strip[12:20, 33:40] = -3.0
    assert not stands_clear(look, 0, 200.0, 12.0)


def looked(extent: HeldExtent, ends_px: tuple[float, float], jaws_px: float, times: int = 8) -> None:
    """Let ``extent`` see silhouettes up to ``ends_px`` outward, again and again."""
    for _ in range(times):
        extent.presence[:] = np.stack([np.where(end >= AT_PX, 0.9, 0.0) for end in ends_px])
        extent.looks += 10
        extent.judge(jaws_px)


def test_what_is_seen_beyond_the_jaws_edge_in_the_frame_is_there() -> None:
    extent = HeldExtent(False, PARAMS)
    assert extent.beyond_px == PARAMS.held_report_px
    looked(extent, (22.0, 22.0), 0.0)
    assert extent.beyond_px == pytest.approx(22.0 + PARAMS.presence_margin_px, abs=1.5)
    looked(extent, (4.0, 4.0), -10.0)
    assert extent.beyond_px > 20.0, "covered up later, it is still there"


def test_a_short_glimpse_is_not_believed() -> None:
    extent = HeldExtent(False, PARAMS)
    for seen_px in (22.0, 22.0, 22.0, 2.0, 22.0, 22.0):
        looked(extent, (seen_px, seen_px), 0.0, times=1)
    assert extent.beyond_px == PARAMS.held_report_px


def test_one_silhouette_may_be_the_jaws_own_edge() -> None:
    extent = HeldExtent(False, PARAMS)
    looked(extent, (30.0, 2.0), 0.0)
    assert extent.beyond_px == PARAMS.held_report_px


def test_jaws_that_move_away_and_uncover_nothing_show_its_end() -> None:
    extent = HeldExtent(False, PARAMS)
    looked(extent, (1.0, 1.0), 0.0)
    assert extent.beyond_px == PARAMS.held_report_px
    looked(extent, (1.0, 1.0), 30.0)
    assert extent.beyond_px == pytest.approx(1.0, abs=1.5)


def test_without_new_looks_nothing_is_judged() -> None:
    extent = HeldExtent(False, PARAMS)
    looked(extent, (1.0, 1.0), 0.0)
    extent.presence[:] = 0.9
    for _ in range(20):
        extent.judge(30.0)
    assert extent.beyond_px == PARAMS.held_report_px


def test_an_end_that_the_frame_shows_needs_more_to_be_moved() -> None:
    extent = HeldExtent(True, PARAMS)
    assert extent.beyond_px == 0.0
    looked(extent, (4.0, 4.0), 0.0)
    assert extent.beyond_px == 0.0
    looked(extent, (22.0, 22.0), 0.0)
    assert extent.beyond_px > 20.0
