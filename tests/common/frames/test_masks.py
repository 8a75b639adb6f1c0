"""Masks: de-duplication, union, cleaning, the classical foreground's parts."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from motiondlo.frames.classical import cut_wide, fill_holes, remove_thin
from motiondlo.frames.mask_cleaning import adaptive_closing, clean_mask, close, remove_small, smallest_component_gap
from motiondlo.frames.masks import ScoredMask, fit_mask, suppress_duplicates, union
from motiondlo.frames.params import CleaningParams
from motiondlo.frames.polyline_fit import diameter_from_distance
from motiondlo.frames.skeleton_graph import distance_inside

SHAPE = (486, 648)


def box(x, y, w, h):
    mask = np.zeros(SHAPE, np.uint8)
    mask[y : y + h, x : x + w] = 1
    return mask


def test_the_larger_of_two_overlapping_masks_stays_with_the_better_score():
    small, large, other = box(10, 10, 90, 20), box(10, 10, 100, 20), box(10, 200, 100, 20)
    masks = (ScoredMask(small, 0.9), ScoredMask(large, 0.5), ScoredMask(other, 0.7))
    kept = suppress_duplicates(masks, max_iou=0.7)
    assert [int(m.mask.sum()) for m in kept] == [2000, 2000]
    assert sorted(m.score for m in kept) == [0.7, 0.9]
    assert len(suppress_duplicates(masks, max_iou=0.95)) == 3


def test_tiny_masks_are_dropped_by_their_pixel_count():
    assert suppress_duplicates((ScoredMask(box(10, 10, 2, 1), 0.9),), max_iou=0.7, min_area=100) == ()


def test_union_brings_masks_of_any_size_to_one():
    double = cv2.resize(box(100, 100, 50, 20), (SHAPE[1] * 2, SHAPE[0] * 2), interpolation=cv2.INTER_NEAREST)
    merged = union((ScoredMask(double, 1.0), ScoredMask(box(300, 100, 50, 20), 1.0)), SHAPE)
    np.testing.assert_array_equal(merged, box(100, 100, 50, 20) | box(300, 100, 50, 20))
    assert fit_mask(np.ones((1944, 2592), np.uint8), SHAPE).all()


def test_gap_between_components():
    mask = box(100, 100, 100, 20) | box(210, 100, 100, 20)
    assert smallest_component_gap(mask) == pytest.approx(11.0, abs=1.5)
    assert smallest_component_gap(box(100, 100, 100, 20)) == np.inf


def test_second_closing_bridges_holes_of_one_cable_but_keeps_neighbours_apart():
    params = CleaningParams()
    slit = box(100, 100, 200, 20)
    slit[108:112, 150:250] = 0
    reach = 2 * params.adaptive_radius * SHAPE[1]
    assert reach > 4
    assert adaptive_closing(box(100, 100, 200, 20) | box(100, 124, 200, 20), params)[122, 200] == 0
    assert adaptive_closing(slit, params)[110, 170] == 1


def test_cleaning_fills_small_holes_and_drops_small_pieces():
    mask = box(100, 100, 200, 16) | box(500, 300, 8, 8)
    mask[107:109, 200:202] = 0
    clean = clean_mask(mask, CleaningParams())
    assert clean[108, 201] == 1
    assert clean[304, 504] == 0
    assert remove_small(mask, 1000).sum() == mask[:200].sum()


def test_closing_keeps_the_width_at_the_image_border():
    mask = box(0, 100, 60, 16)
    np.testing.assert_array_equal(close(mask, 5.0), mask)


def test_wide_things_are_cut_out_and_thin_ones_removed():
    cable, gripper, text = box(100, 200, 300, 16), box(400, 160, 120, 90), box(50, 50, 100, 3)
    rest, obstacles = cut_wide(cable | gripper, 34.0)
    assert rest[208, 150] == 1
    assert rest[208, 450] == 0
    assert obstacles[208, 450] == 1
    assert obstacles[208, 150] == 0
    assert remove_thin(cable | text, 8.0)[51, 80] == 0
    assert remove_thin(cable | text, 8.0)[208, 150] == 1


def test_crossing_of_two_cables_is_not_wide():
    mask = np.zeros(SHAPE, np.uint8)
    cv2.line(mask, (100, 100), (500, 400), 1, 17)
    cv2.line(mask, (100, 400), (500, 100), 1, 17)
    rest, obstacles = cut_wide(mask, 34.0)
    np.testing.assert_array_equal(rest, mask)
    assert not obstacles.any()


def test_only_small_holes_are_filled():
    ring = np.zeros(SHAPE, np.uint8)
    cv2.circle(ring, (300, 240), 60, 1, 9)
    assert fill_holes(ring, 100.0)[240, 300] == 0
    assert fill_holes(ring, 20000.0)[240, 300] == 1


def test_diameter_of_a_band():
    mask = box(100, 100, 300, 17)
    assert diameter_from_distance(distance_inside(mask), mask) == pytest.approx(0.75 * 17, abs=2.0)
    assert diameter_from_distance(distance_inside(mask), np.zeros_like(mask)) == 0.0
