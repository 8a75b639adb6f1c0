"""The one-pass sampler against a plain numpy twin."""

from __future__ import annotations

import numpy as np
import pytest

from motiondlo.frames.strip_kernels import sample_pair
from motiondlo.geometry.curve import left_normals, tangents

OFFSET = 8.0


def bilinear(values, places):
    """(H, W, C) at (..., 2), the border goes on."""
    height, width = values.shape[:2]
    x = np.clip(places[..., 0], 0.0, width - 1.0)
    y = np.clip(places[..., 1], 0.0, height - 1.0)
    x0, y0 = x.astype(int), y.astype(int)
    x1, y1 = np.minimum(x0 + 1, width - 1), np.minimum(y0 + 1, height - 1)
    u, v = (x - x0)[..., None], (y - y0)[..., None]
    values = values.astype(np.float64)
    top = values[y0, x0] * (1 - u) + values[y0, x1] * u
    bottom = values[y1, x0] * (1 - u) + values[y1, x1] * u
    return top * (1 - v) + bottom * v


def twin(image, board, gain, scale, centre, normals, offsets):
    places = centre[:, None] + offsets[None, :, None] * normals[:, None]
    seen, empty = bilinear(image, places), bilinear(board, places)
    rim = bilinear(gain, (places[:, [0, -1]] + 0.5) / scale - 0.5)
    share = np.linspace(0.0, 1.0, len(offsets))[None, :, None]
    factor = rim[:, :1] * (1 - share) + rim[:, 1:] * share
    height, width = image.shape[:2]
    known = ((places >= 0) & (places <= (width - 1, height - 1))).all(axis=-1)
    return seen, (seen + OFFSET) / (empty * factor + OFFSET), known


@pytest.mark.parametrize("gain_shape", [(1, 1, 3), (20, 30, 3)])
def test_samples_are_the_twins(gain_shape):
    rng = np.random.default_rng(3)
    image = rng.integers(0, 256, (40, 60, 3)).astype(np.uint8)
    board = rng.integers(0, 256, (40, 60, 3)).astype(np.uint8)
    gain = rng.uniform(0.8, 1.2, gain_shape).astype(np.float32)
    # It leaves the image at the left and at the top.
    centre = np.stack([np.linspace(-3.0, 45.0, 30), 20.0 - 22.0 * np.sin(np.linspace(0.0, 1.4, 30))], axis=1)
    normals = np.ascontiguousarray(left_normals(tangents(centre)))
    offsets = np.arange(-9, 10) * 0.7
    shape = (len(centre), len(offsets))
    out_image, out_ratio = np.empty((*shape, 3), np.float32), np.empty((*shape, 3), np.float32)
    known = np.empty(shape, np.bool_)
    sample_pair(image, board, gain, 2.0, OFFSET, centre, normals, offsets, out_image, out_ratio, known)
    seen, ratio, inside = twin(image, board, gain, 2.0, centre, normals, offsets)
    np.testing.assert_allclose(out_image, seen, atol=2e-3)
    np.testing.assert_allclose(out_ratio, ratio, rtol=1e-4)
    np.testing.assert_array_equal(known, inside)
    assert known.any()
    assert not known.all()
