"""One random generator per purpose, from the scene's name and the seed: one choice more moves no other."""

from __future__ import annotations

import zlib
from enum import IntEnum

import numpy as np


class Purpose(IntEnum):
    """What numbers are drawn for."""

    PLAN = 1
    PIXELS = 2
    NOISE = 3
    VIEWS = 4
    FRAMES = 5


def generator(name: str, seed: int, purpose: Purpose) -> np.random.Generator:
    """The generator for a purpose."""
    return np.random.default_rng([seed, zlib.crc32(name.encode()), int(purpose)])
