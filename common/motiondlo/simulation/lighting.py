"""Light that changes: a lamp on the mains, a flash."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from motiondlo.simulation.cameras import Camera
from motiondlo.simulation.plan import Plan

FloatImage = npt.NDArray[np.float32]


class Lighting:
    """Factor of the light in a camera's image at any time."""

    def __init__(self, plan: Plan, camera: Camera) -> None:
        self._flicker, self._flash = plan.scene.flicker, plan.scene.flash
        y, x = np.mgrid[0 : camera.height, 0 : camera.width].astype(np.float32)
        spot = camera.project(np.array([*plan.flicker_spot_mm, 0.0]))
        radius = (30.0 if self._flicker is None else self._flicker.radius_mm) * float(camera.scale(np.array(0.0)))
        spot_light = np.exp(-0.5 * ((x - spot[0]) ** 2 + (y - spot[1]) ** 2) / radius**2)
        self._spot: FloatImage = spot_light.astype(np.float32)
        self._flat: FloatImage = np.ones(self._spot.shape, np.float32)

    @property
    def changes(self) -> bool:
        """Whether the light changes at all."""
        return self._flicker is not None or self._flash is not None

    def gain(self, time_s: float) -> FloatImage:
        """(H, W) factor."""
        if not self.changes:
            return self._flat
        gain: FloatImage = self._flat
        if self._flicker is not None:
            wave = self._flicker.amplitude * np.sin(2.0 * np.pi * self._flicker.hz * time_s)
            gain = np.asarray(gain + np.float32(wave) * self._spot, np.float32)
        if self._flash is not None and time_s >= self._flash.start_s:
            since = time_s - self._flash.start_s
            # It rises within a millisecond.
            rise = min(1.0, since / 0.001)
            gain = gain + np.float32(self._flash.amplitude * rise * np.exp(-since / self._flash.decay_s))
        return np.asarray(gain, np.float32)
