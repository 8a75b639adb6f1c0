"""The dynamic program against an exhaustive search."""

from __future__ import annotations

from itertools import product

import numpy as np

from motiondlo.frames.edge_kernels import best_path


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
