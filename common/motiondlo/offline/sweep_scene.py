"""A scene for load tests, with exact truth: bright cables that swing over a dark board, and any number of other events.

Each cable is a rigid, gently bent tube that moves as ``amplitude * (1 - cos)`` along a fixed direction; its events lie
on its outline, in proportion to the speed along the outline's normal, with the polarity of a bright tube. What is
missing to the wanted rate is background: short runs of pixels in a row, as a moving texture makes them; some of it is
noise that lies everywhere, the rest moves beside the cables. Deterministic.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from motiondlo.events.types import EventArray, SensorGeometry, empty_events
from motiondlo.events.writer import Evt3Encoder

FloatArray = npt.NDArray[np.float64]

DIAMETER_PX = 20.0
_SLOT_US = 5_000
_PERIOD_US = 160_000
_AMPLITUDE_PX = 12.0
_DIRECTION = np.array([0.25, 0.97])
_EVENTS_PER_CROSSING = 2.0
"""Events that a pixel makes when a silhouette passes it."""
_BLUR_PX = 0.6
_CABLES_SHARE = 0.7
"""At most so much of the rate comes from the cables; where they would make more, their contrast is lower."""
_RUN_PX = 6
_POINTS = 60


@dataclass(frozen=True)
class SweepScene:
    """``dlos`` cables and ``rate_hz`` events a second for ``duration_us``."""

    dlos: int
    rate_hz: float
    duration_us: int
    noise_hz: float = 5e5
    """At most so many background events a second lie anywhere, cables included."""
    geometry: SensorGeometry = field(default_factory=SensorGeometry)

    def offset_px(self, t_us: npt.NDArray[np.int64] | int, cable: int) -> FloatArray:
        """Where a cable has moved to at ``t_us`` (T,) or one time. Returns (T, 2) or (2,) event px."""
        angle = 2.0 * np.pi * np.asarray(t_us, np.float64) / _PERIOD_US
        way = _AMPLITUDE_PX * (1.0 - np.cos(angle)) * (-1.0) ** cable
        return np.asarray(way[..., None] * _DIRECTION)

    def velocity_px_us(self, t_us: int, cable: int) -> FloatArray:
        """(2,) px per microsecond."""
        angular = 2.0 * np.pi / _PERIOD_US
        return np.asarray(_AMPLITUDE_PX * angular * np.sin(angular * t_us) * (-1.0) ** cable * _DIRECTION)

    def nodes(self, cable: int, t_us: int) -> FloatArray:
        """(60, 2) the true centreline, event px, equidistant to a thousandth."""
        spacing = self.geometry.height_px / (self.dlos + 1)
        x = np.linspace(0.2, 0.8, _POINTS) * self.geometry.width_px
        bend = 0.12 * spacing * np.sin(np.linspace(0.0, np.pi, _POINTS))
        start = -_AMPLITUDE_PX * (-1.0) ** cable
        y = spacing * (cable + 1) + start + bend
        return np.stack([x, y], axis=1) + self.offset_px(t_us, cable)

    def raw(self, seed: int = 1) -> tuple[bytes, int]:
        """The scene as EVT3 words, and how many events they hold."""
        rng = np.random.default_rng([seed, self.dlos, round(self.rate_hz)])
        encoder = Evt3Encoder(self.geometry)
        pieces, count = [], 0
        outlines = [_outline(self.nodes(cable, 0)) for cable in range(self.dlos)]
        for t0_us in range(0, self.duration_us, _SLOT_US):
            events = self._slot(t0_us, outlines, rng)
            pieces.append(encoder.encode(events))
            count += len(events)
        return b"".join(pieces), count

    def _slot(self, t0_us: int, outlines: list[tuple[FloatArray, FloatArray]], rng: np.random.Generator) -> EventArray:
        middle_us = t0_us + _SLOT_US // 2
        wanted = self.rate_hz * _SLOT_US * 1e-6
        weights = [
            np.abs(normals @ self.velocity_px_us(middle_us, cable)) * _SLOT_US * _EVENTS_PER_CROSSING
            for cable, (_, normals) in enumerate(outlines)
        ]
        thinning = min(1.0, _CABLES_SHARE * wanted / max(sum(float(w.sum()) for w in weights), 1e-9))
        parts = [
            self._silhouettes(t0_us, cable, outline, weight * thinning, rng)
            for cable, (outline, weight) in enumerate(zip(outlines, weights, strict=True))
        ]
        parts.append(self._background(t0_us, max(0, round(wanted) - sum(len(part) for part in parts)), rng))
        events = np.concatenate(parts)
        # As a sensor reads out: row by row within a time stamp.
        return events[np.lexsort((events["x"], events["y"], events["t"]))]

    def _silhouettes(
        self,
        t0_us: int,
        cable: int,
        outline: tuple[FloatArray, FloatArray],
        expected: FloatArray,
        rng: np.random.Generator,
    ) -> EventArray:
        points, normals = outline
        at = np.repeat(np.arange(len(points)), rng.poisson(expected))
        t_us = t0_us + rng.integers(0, _SLOT_US, len(at))
        leading = (normals @ self.velocity_px_us(t0_us + _SLOT_US // 2, cable))[at] > 0.0
        places = points[at] + self.offset_px(t_us, cable) + normals[at] * rng.normal(0.0, _BLUR_PX, (len(at), 1))
        xy = np.rint(places).astype(np.int64)
        inside = ((xy >= 0) & (xy < (self.geometry.width_px, self.geometry.height_px))).all(axis=1)
        events = empty_events(int(inside.sum()))
        events["t"], events["x"], events["y"] = t_us[inside], xy[inside, 0], xy[inside, 1]
        events["p"] = leading[inside]
        return events

    def _background(self, t0_us: int, count: int, rng: np.random.Generator) -> EventArray:
        runs = -(-count // _RUN_PX)
        events = empty_events(runs * _RUN_PX)
        events["t"] = np.repeat(t0_us + rng.integers(0, _SLOT_US, runs), _RUN_PX)
        events["y"] = np.repeat(rng.integers(0, self.geometry.height_px, runs), _RUN_PX)
        width = self.geometry.width_px
        noise = min(runs, round(self.noise_hz * _SLOT_US * 1e-6 / _RUN_PX))
        # Left and right of the cables, which end at a fifth of the width.
        first = rng.integers(0, round(0.17 * width) - _RUN_PX, runs)
        first[rng.random(runs) < 0.5] += round(0.83 * width)
        first[:noise] = rng.integers(0, width - _RUN_PX, noise)
        events["x"] = np.repeat(first, _RUN_PX) + np.tile(np.arange(_RUN_PX), runs)
        events["p"] = np.repeat(rng.integers(0, 2, runs), _RUN_PX)
        return events[:count]


def _outline(nodes: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Points about 1 px apart on a tube's outline, round at both ends, and outward normals; (N, 2) each."""
    radius = 0.5 * DIAMETER_PX
    steps = np.diff(nodes, axis=0)
    s = np.concatenate([[0.0], np.cumsum(np.hypot(steps[:, 0], steps[:, 1]))])
    at = np.arange(0.0, s[-1], 1.0)
    line = np.stack([np.interp(at, s, nodes[:, k]) for k in range(2)], axis=1)
    tangent = np.gradient(line, axis=0)
    tangent /= np.hypot(tangent[:, 0], tangent[:, 1])[:, None]
    left = np.stack([-tangent[:, 1], tangent[:, 0]], axis=1)
    points, normals = [line + radius * left, line - radius * left], [left, -left]
    half = np.linspace(-0.5 * np.pi, 0.5 * np.pi, round(np.pi * radius))
    for end, outward in ((line[0], -tangent[0]), (line[-1], tangent[-1])):
        across = np.array([-outward[1], outward[0]])
        cap = np.cos(half)[:, None] * outward + np.sin(half)[:, None] * across
        points.append(end + radius * cap)
        normals.append(cap)
    return np.concatenate(points), np.concatenate(normals)
