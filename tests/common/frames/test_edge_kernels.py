"""The dynamic program against an exhaustive search."""

from __future__ import annotations

from itertools import product

import numpy as np

from motiondlo.frames.edge_kernels import best_path, pair_strength


def exhaustive(strength, cost):
    rows, count = strength.shape
    best = (-np.inf, None)
    for path in product(range(count), repeat=rows):
        steps = np.abs(np.diff(path))
        if steps.max() > 1:
            continue
        value = strength[np.arange(rows), list(path)].sum() - cost * steps.sum()
        if value > best[0]:
            best = (value, path)
    return best


def test_path_is_the_best_of_all():
    rng = np.random.default_rng(1)
    for _ in range(5):
        strength = rng.random((6, 5))
        out = np.empty(6, np.int64)
        best_path(strength, 0.15, out)
        _, path = exhaustive(strength, 0.15)
        assert tuple(out) == path
        assert np.abs(np.diff(out)).max() <= 1


def test_path_crosses_a_stretch_without_edges():
    strength = np.zeros((30, 21))
    strength[:10, 6] = 1.0
    strength[20:, 10] = 1.0
    out = np.empty(30, np.int64)
    best_path(strength, 0.15, out)
    assert (out[:10] == 6).all()
    assert (out[20:] == 10).all()


def test_pairs_of_edges_are_those_of_the_plain_formula():
    rng = np.random.default_rng(5)
    saturated, half, reach = rng.random((6, 41)), 6.3, 9
    out = np.empty((6, 2 * reach + 1))
    pair_strength(saturated, half, out)
    columns = np.arange(41)
    for k, row in enumerate(saturated):
        candidates = np.arange(-reach, reach + 1)
        left = np.interp(20 + candidates - half, columns, row)
        right = np.interp(20 + candidates + half, columns, row)
        plain = 0.5 * (left + right) + np.minimum(left, right) - 0.02 * np.abs(candidates) / reach
        np.testing.assert_allclose(out[k], plain, atol=1e-12)
