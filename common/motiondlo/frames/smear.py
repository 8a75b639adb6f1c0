"""Whether something that lies where a DLO was expected has edges at all: motion smears them beyond measuring."""

from __future__ import annotations

import numpy as np
from scipy.ndimage import uniform_filter1d

from motiondlo.frames.strip import Scene, sample_strip
from motiondlo.frames.traversal import Chain

_ALONG_PX = 9
_LEAST_CONTRAST = 20.0
"""Grey levels; below, noise makes the edges."""


def rise_px(scene: Scene, chain: Chain) -> float:
    """10-90 % width of the steepest edge across a chain, image px, median along it; 0 where there is no contrast."""
    centre = (chain.path + 0.5) * scene.board.scale - 0.5
    if len(centre) < 3:
        return 0.0
    strip = sample_strip(scene, centre, 1.5 * chain.width * scene.board.scale, 1.0)
    profiles = uniform_filter1d(strip.image, _ALONG_PX, axis=0)[strip.known.all(axis=1)]
    if not len(profiles):
        return 0.0
    contrast = np.ptp(profiles, axis=1)
    slope = np.abs(np.diff(profiles, axis=1)).max(axis=1)
    best = contrast.argmax(axis=1)[:, None]
    contrast, slope = (np.take_along_axis(values, best, axis=1)[:, 0] for values in (contrast, slope))
    if float(np.median(contrast)) < _LEAST_CONTRAST:
        return 0.0
    return float(np.median(0.8 * contrast / np.maximum(slope, 1e-6)))
