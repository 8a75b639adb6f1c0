"""Thinning on an active list against a plain numpy twin."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from motiondlo.frames.thinning_kernels import degrees, remove_corners, thin

RING = ((1, 0), (1, -1), (0, -1), (-1, -1), (-1, 0), (-1, 1), (0, 1), (1, 1))


def twin(mask):
    """Zhang and Suen's two sub-iterations on the whole image."""
    m = mask.copy().astype(bool)
    while True:
        before = m.copy()
        for phase in (0, 1):
            ring = [np.roll(m, shift, (0, 1)) for shift in RING]
            total = sum(r.astype(int) for r in ring)
            turns = sum((~ring[i] & ring[(i + 1) % 8]).astype(int) for i in range(8))
            n, e, s, w = ring[0], ring[2], ring[4], ring[6]
            blocked = (n & e & s) | (e & s & w) if phase == 0 else (n & e & w) | (n & s & w)
            m &= ~((total >= 2) & (total <= 6) & (turns == 1) & ~blocked)
        if (m == before).all():
            return m.astype(np.uint8)


def thinned(mask):
    out = mask.copy()
    ys, xs = np.nonzero(out)
    thin(out, ys.astype(np.int32), xs.astype(np.int32))
    return out


def shapes():
    band = np.zeros((60, 80), np.uint8)
    cv2.line(band, (10, 10), (70, 45), 1, 9)
    ring = np.zeros((60, 80), np.uint8)
    cv2.circle(ring, (40, 30), 20, 1, 7)
    cross = band.copy()
    cv2.line(cross, (65, 8), (12, 50), 1, 7)
    rng = np.random.default_rng(3)
    noise = np.zeros((60, 80), np.uint8)
    noise[2:-2, 2:-2] = cv2.GaussianBlur(rng.normal(size=(56, 76)), (0, 0), 2.0) > 0.0
    return {"band": band, "ring": ring, "cross": cross, "noise": noise}


@pytest.mark.parametrize("shape", shapes())
def test_kernel_equals_the_twin(shape):
    mask = shapes()[shape]
    np.testing.assert_array_equal(thinned(mask), twin(mask))


@pytest.mark.parametrize("shape", shapes())
def test_corners_go_and_topology_stays(shape):
    skeleton = thinned(shapes()[shape])
    before = skeleton.copy()
    ys, xs = np.nonzero(skeleton)
    remove_corners(skeleton, ys.astype(np.int32), xs.astype(np.int32))
    assert cv2.connectedComponents(skeleton, connectivity=8)[0] == cv2.connectedComponents(before, connectivity=8)[0]
    holes = [cv2.connectedComponents(1 - m, connectivity=4)[0] for m in (skeleton, before)]
    assert holes[0] == holes[1]


def test_a_slanted_band_has_two_tips_and_no_junction():
    skeleton = thinned(shapes()["band"])
    ys, xs = np.nonzero(skeleton)
    remove_corners(skeleton, ys.astype(np.int32), xs.astype(np.int32))
    degree = np.zeros_like(skeleton)
    degrees(skeleton, degree)
    values = degree[skeleton > 0]
    assert (values == 1).sum() == 2
    assert (values > 2).sum() == 0
