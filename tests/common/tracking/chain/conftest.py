"""A drawn scene: cables over a board, one of them in a gripper, turned into events by comparing pictures."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import cv2
import numpy as np
import pytest

from motiondlo.events.types import EVENT_DTYPE, EventBatch, SensorGeometry, empty_events
from motiondlo.frames.appearance import sample_appearance
from motiondlo.frames.types import EndKind
from motiondlo.tracking.types import Correction, CorrectionKind

WIDTH, HEIGHT = 480, 320
RADIUS_PX = 9.0
LENGTH_PX = 260.0
_SUBSTEPS = 4
_THRESHOLD = 0.3

Motion = Callable[[float], tuple[float, float]]


def ramp(
    velocity_px_ms: tuple[float, float], start_ms: float = 5.0, rise_ms: float = 6.0, stop_ms: float = 1e9
) -> Motion:
    """Displacement over time: at rest until ``start_ms``, then smoothly up to a velocity, at rest from ``stop_ms``."""

    def way(t_ms: float) -> tuple[float, float]:
        t = max(0.0, min(t_ms, stop_ms) - start_ms)
        s = 0.5 * t * t / rise_ms if t < rise_ms else t - 0.5 * rise_ms
        return velocity_px_ms[0] * s, velocity_px_ms[1] * s

    return way


@dataclass
class Cable:
    """A gently bent cable that moves as a whole; its left end may be in a gripper with marks on it."""

    motion: Motion
    start: tuple[float, float] = (120.0, 110.0)
    bend_px: float = 25.0
    grey: int = 230
    held: bool = False
    marks: bool = False

    def nodes(self, t_ms: float, count: int = 60) -> np.ndarray:
        u = np.linspace(0.0, 1.0, count)
        dx, dy = self.motion(t_ms)
        x = self.start[0] + dx + LENGTH_PX * u
        y = self.start[1] + dy + self.bend_px * np.sin(np.pi * u)
        return np.stack([x, y], axis=1)

    def draw(self, image: np.ndarray, t_ms: float) -> None:
        nodes = self.nodes(t_ms)
        shifted = np.round(nodes * 16).astype(np.int32)
        cv2.polylines(image, [shifted], False, self.grey, int(2 * RADIUS_PX), cv2.LINE_AA, shift=4)
        # Round caps would hide where the cable ends.
        for end, inner in ((nodes[0], nodes[2]), (nodes[-1], nodes[-3])):
            out = (end - inner) / np.hypot(*(end - inner))
            side = np.array([-out[1], out[0]])
            box = end + np.array([[0.5, -14.0], [14.0, -14.0], [14.0, 14.0], [0.5, 14.0]]) @ np.stack([out, side])
            cv2.fillPoly(image, [np.round(box * 16).astype(np.int32)], 40, cv2.LINE_AA, shift=4)
        if self.marks:
            for k in (12, 15, 17, 26, 30, 33, 44, 46, 51):
                a, b = nodes[k], nodes[k + 1]
                side = np.array([-(b - a)[1], (b - a)[0]]) / np.hypot(*(b - a)) * 0.7 * RADIUS_PX
                corners = np.stack([a - side, b - side, b + side, a + side])
                cv2.fillPoly(image, [np.round(corners * 16).astype(np.int32)], 90, cv2.LINE_AA, shift=4)
        if self.held:
            x, y = nodes[0]
            corners = np.array([[x - 90, y - 30], [x, y - 30], [x, y + 30], [x - 90, y + 30]])
            cv2.fillPoly(image, [np.round(corners * 16).astype(np.int32)], 150, cv2.LINE_AA, shift=4)
            for mx, my in ((-20, -12), (-34, 15), (-52, -5), (-66, 18), (-70, -18)):
                centre = (round((x + mx) * 16), round((y + my) * 16))
                cv2.circle(image, centre, 6 * 16, 20, -1, cv2.LINE_AA, shift=4)


@dataclass
class Scene:
    """Cables on a dark board seen by a small event camera and a frame camera with the same pixels."""

    cables: tuple[Cable, ...]
    cover: tuple[int, int] | None = None
    """Columns that a plate hides."""
    geometry: SensorGeometry = field(default_factory=lambda: SensorGeometry(WIDTH, HEIGHT))

    def __post_init__(self) -> None:
        self._reference = self._log(0.0)
        self._at_us = 0

    def picture(self, t_ms: float) -> np.ndarray:
        image = np.full((HEIGHT, WIDTH), 40, np.uint8)
        for cable in self.cables:
            cable.draw(image, t_ms)
        if self.cover is not None:
            image[:, self.cover[0] : self.cover[1]] = 110
        return image

    def _log(self, t_ms: float) -> np.ndarray:
        return 2.2 * np.log(self.picture(t_ms).astype(np.float64) / 255.0)

    def batch(self, t0_us: int, period_us: int = 1000) -> EventBatch:
        """Events from ``t0_us`` on; batches must be asked for in order."""
        assert t0_us == self._at_us
        steps = max(1, _SUBSTEPS * period_us // 1000)
        width_us = period_us // steps
        parts = []
        for k in range(steps):
            t = t0_us + k * width_us
            now = self._log((t + width_us) * 1e-3)
            change = now - self._reference
            for polarity, fired in ((1, change > _THRESHOLD), (0, change < -_THRESHOLD)):
                y, x = np.nonzero(fired)
                part = np.zeros(len(x), EVENT_DTYPE)
                part["t"], part["x"], part["y"], part["p"] = t + width_us // 2, x, y, polarity
                parts.append(part)
                self._reference[fired] = now[fired]
        self._at_us = t0_us + period_us
        return EventBatch(t0_us, t0_us + period_us, np.concatenate(parts) if parts else empty_events())

    def correction(
        self,
        which: int = 0,
        seq: int = 1,
        t_us: int = 0,
        kind: CorrectionKind = CorrectionKind.REINITIALISE,
        shift_px: tuple[float, float] = (0.0, 0.0),
        not_before_us: int = -1,
        look: bool = True,
        ends: tuple[EndKind, EndKind] | None = None,
    ) -> Correction:
        cable = self.cables[which]
        nodes = cable.nodes(t_us * 1e-3)
        image = np.repeat(self.picture(t_us * 1e-3)[:, :, None], 3, axis=2)
        own_ends = (EndKind.HELD if cable.held else EndKind.TIP, EndKind.TIP)
        return Correction(
            seq=seq,
            id=which,
            t_us=t_us,
            kind=kind,
            nodes=nodes + np.array(shift_px),
            sigma_normal_px=np.full(len(nodes), 1.0),
            sigma_tangent_px=np.full(len(nodes), 3.0),
            diameter_px=2 * RADIUS_PX,
            ends=own_ends if ends is None else ends,
            appearance=sample_appearance(image, np.eye(3), nodes, 2 * RADIUS_PX) if look else None,
            not_before_us=not_before_us,
        )


@pytest.fixture
def make_scene() -> Callable[..., Scene]:
    def make(*cables: Cable, cover: tuple[int, int] | None = None) -> Scene:
        return Scene(tuple(cables), cover)

    return make


@pytest.fixture
def make_cable() -> type[Cable]:
    return Cable


@pytest.fixture
def moving() -> Callable[..., Motion]:
    return ramp
