"""A bright bar that moves over a dark board, made events by comparing pictures a quarter of a millisecond apart."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pytest

from motiondlo.events.types import EVENT_DTYPE, EventBatch, SensorGeometry
from motiondlo.frames.types import Appearance, EndKind
from motiondlo.tracking.types import Correction, CorrectionKind

GEOMETRY = SensorGeometry(420, 300)
RADIUS_PX = 8.0
LENGTH_PX = 240.0
_SUBSTEPS = 4


@dataclass
class BarScene:
    """A horizontal bar whose left end is at ``path(t_ms)``; the columns within ``cover_px`` are covered."""

    path: Callable[[float], tuple[float, float]]
    cover_px: tuple[float, float] = (1e9, 1e9)
    geometry: SensorGeometry = GEOMETRY

    def mask(self, t_ms: float) -> np.ndarray:
        x0, y0 = self.path(t_ms)
        x = np.arange(self.geometry.width_px)
        y = np.arange(self.geometry.height_px)
        columns = (x >= x0) & (x <= x0 + LENGTH_PX) & ~((x >= self.cover_px[0]) & (x <= self.cover_px[1]))
        return np.outer(np.abs(y - y0) <= RADIUS_PX, columns)

    def batch(self, k: int, period_us: int = 1000) -> EventBatch:
        t0 = k * period_us
        rows = []
        substeps = max(1, _SUBSTEPS * period_us // 1000)
        width_us = period_us // substeps
        before = self.mask(t0 * 1e-3)
        for i in range(substeps):
            t = t0 + i * width_us
            after = self.mask((t + width_us) * 1e-3)
            for polarity, changed in ((1, after & ~before), (0, before & ~after)):
                y, x = np.nonzero(changed)
                part = np.zeros(len(x), EVENT_DTYPE)
                part["t"], part["x"], part["y"], part["p"] = t + width_us // 2, x, y, polarity
                rows.append(part)
            before = after
        return EventBatch(t0, t0 + period_us, np.concatenate(rows))

    def nodes(self, t_ms: float, count: int = 40) -> np.ndarray:
        x0, y0 = self.path(t_ms)
        return np.stack([np.linspace(x0, x0 + LENGTH_PX, count), np.full(count, y0)], axis=1)

    def correction(
        self,
        seq: int = 0,
        t_us: int = 0,
        kind: CorrectionKind = CorrectionKind.REINITIALISE,
        shift_px: tuple[float, float] = (0.0, 0.0),
        ends: tuple[EndKind, EndKind] = (EndKind.TIP, EndKind.TIP),
        dlo_id: int = 1,
        not_before_us: int = -1,
    ) -> Correction:
        nodes = self.nodes(t_us * 1e-3) + np.array(shift_px)
        return Correction(
            seq=seq,
            id=dlo_id,
            t_us=t_us,
            kind=kind,
            nodes=nodes,
            sigma_normal_px=np.full(len(nodes), 1.0),
            sigma_tangent_px=np.full(len(nodes), 3.0),
            diameter_px=2 * RADIUS_PX,
            ends=ends,
            appearance=bar_appearance(),
            not_before_us=not_before_us,
        )


def bar_appearance() -> Appearance:
    """The bar straightened: bright within its radius, dark outside."""
    rows, columns = int((LENGTH_PX + 160.0) / 2.0), 97
    offset = np.arange(columns) - 48
    strip = np.where(np.abs(offset) <= RADIUS_PX, np.log(0.5), np.log(0.1))
    strip = np.tile(strip.astype(np.float32), (rows, 1))
    return Appearance(strip, np.ones_like(strip, dtype=np.uint8), -80.0)


def sweep(speed_px_ms: tuple[float, float] = (0.0, 1.5), start_ms: float = 5.0, ramp_ms: float = 6.0):
    """From rest at (80, 80): after ``start_ms`` it speeds up within ``ramp_ms``."""

    def path(t_ms: float) -> tuple[float, float]:
        t = max(0.0, t_ms - start_ms)
        way = 0.5 * t**2 / ramp_ms if t < ramp_ms else t - 0.5 * ramp_ms
        return 80.0 + speed_px_ms[0] * way, 80.0 + speed_px_ms[1] * way

    return path


@pytest.fixture
def bar_scene() -> type[BarScene]:
    return BarScene


@pytest.fixture
def sweep_path() -> Callable[..., Callable[[float], tuple[float, float]]]:
    return sweep
