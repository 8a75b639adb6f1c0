"""Recentness map with adaptive decay, as a threshold on ages (paper, "Event Branch: Dynamic DLO").

The paper: R = max over polarities of exp(-(t - T) / tau), "subsequently thresholded to isolate active DLO regions". R >
r is the same as t - T < -tau ln r, so no exponential is ever taken over the sensor; Otsu's threshold r is found on a
histogram of the ages of the active pixels.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from motiondlo.tracking.paper.params import PaperParams

AGE_BINS = 128
# Recentness below this is not "active": it takes no part in Otsu's threshold.
ACTIVE_RECENTNESS = 0.01


class AdaptiveDecay:
    """The decay time tau between ``tau_min_us`` and ``tau_max_us`` by event rate, so that slow motion leaves a map too.

    The paper gives the range; linear in the logarithm of the smoothed rate in between is our choice.
    """

    _SMOOTHING_US = 10_000.0

    def __init__(self, params: PaperParams) -> None:
        self._params = params
        self._rate_hz = 0.0

    def update(self, events: int, span_us: int) -> float:
        """tau in us, after ``events`` events arrived in ``span_us``."""
        p = self._params
        if not p.adaptive_decay:
            return float(p.tau_fixed_us)
        if span_us > 0:
            weight = 1.0 - np.exp(-span_us / self._SMOOTHING_US)
            self._rate_hz += float(weight) * (events * 1e6 / span_us - self._rate_hz)
        low, high = np.log(p.rate_low_hz), np.log(p.rate_high_hz)
        u = (
            (np.log(max(self._rate_hz, 1e-3)) - low) / (high - low)
            if high > low
            else float(self._rate_hz > p.rate_low_hz)
        )
        return float(p.tau_max_us + np.clip(u, 0.0, 1.0) * (p.tau_min_us - p.tau_max_us))


def active_age_us(tau_us: float) -> float:
    """Age from which a pixel is no longer active."""
    return float(-tau_us * np.log(ACTIVE_RECENTNESS))


def recentness_threshold(age_counts: npt.NDArray[np.int64], tau_us: float, low: float, high: float) -> float:
    """Otsu's threshold on recentness, clamped to ``low..high`` (paper).

    age_counts: (AGE_BINS,) pixels per bin of equal age between 0 and ``active_age_us(tau_us)``. Without pixels,
    ``low``.
    """
    total = int(age_counts.sum())
    if total == 0:
        return low
    ages_us = (np.arange(len(age_counts)) + 0.5) * (active_age_us(tau_us) / len(age_counts))
    r = np.exp(-ages_us / tau_us)
    w = np.cumsum(age_counts) / total  # share of the younger class
    m = np.cumsum(age_counts * r) / total
    between = np.zeros(len(r))
    inner = (w > 0.0) & (w < 1.0)
    between[inner] = (m[-1] * w[inner] - m[inner]) ** 2 / (w[inner] * (1.0 - w[inner]))
    k = int(between.argmax())
    edge_us = (k + 1) * (active_age_us(tau_us) / len(age_counts))
    return float(np.clip(np.exp(-edge_us / tau_us), low, high))


def oldest_age_us(recentness: float, tau_us: float) -> float:
    """The age that has this recentness."""
    return float(-tau_us * np.log(recentness))


def longest_ages_us(
    velocity_px_s: npt.NDArray[np.float64], nodes: npt.NDArray[np.float64], distance_px: float, shortest_us: float
) -> npt.NDArray[np.float64]:
    """How long each segment of the DLO takes to move by ``distance_px`` across its own line (motion-limited decay).

    The paper's decay is "adaptive" without a rule for fast motion, and 15 ms at 7 px/ms would be a trail of 200 px with
    the DLO at its front. Both edges leave a trail as long as the oldest age; what remains between them is closed by the
    morphology, and the centre of it all lags by half the trail. velocity_px_s, nodes: (M, 2). Returns (M - 1,) us, at
    least ``shortest_us``, inf at rest.
    """
    middle = 0.5 * (velocity_px_s[1:] + velocity_px_s[:-1])
    step = np.diff(nodes, axis=0)
    length = np.maximum(np.hypot(step[:, 0], step[:, 1]), 1e-9)
    across = np.abs(middle[:, 0] * step[:, 1] - middle[:, 1] * step[:, 0]) / length
    ages = np.full(len(across), np.inf)
    moves = across > 1e-6
    ages[moves] = distance_px / across[moves] * 1e6
    return np.asarray(np.maximum(ages, shortest_us), dtype=np.float64)
