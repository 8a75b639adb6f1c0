"""The RGB camera: exposures, during which things move on, and pictures of the empty board."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from motiondlo.simulation.lighting import Lighting
from motiondlo.simulation.renderer import Renderer

FloatImage = npt.NDArray[np.float32]
Image = npt.NDArray[np.uint8]

EXPOSURE_US = 5000
PERIOD_US = 50000
FIRST_US = 12000
_MOST_SAMPLES = 24
_PX_PER_SAMPLE = 2.0
_NOISE = 0.9


def trigger_times(duration_us: int, rng: np.random.Generator) -> list[int]:
    """Starts of the exposures, us, with the camera's jitter; the last one ends within the recording."""
    count = max(0, (duration_us - FIRST_US - EXPOSURE_US - 10) // PERIOD_US + 1)
    return [FIRST_US + PERIOD_US * i + int(jitter) for i, jitter in enumerate(rng.integers(-3, 4, count))]


def expose(renderer: Renderer, lighting: Lighting, start_us: int, rng: np.random.Generator) -> Image:
    """(H, W, 3) BGR picture: the mean of the light over the exposure."""
    start_s, span_s = start_us * 1e-6, EXPOSURE_US * 1e-6
    way = renderer.largest_step_px(start_s, start_s + span_s)
    least = 5 if lighting.changes else 1
    samples = int(min(max(np.ceil(way / _PX_PER_SAMPLE), least), _MOST_SAMPLES))
    total = np.zeros_like(renderer.image)
    for i in range(samples):
        time_s = start_s + span_s * (i + 0.5) / samples
        renderer.draw(time_s)
        total += renderer.image * lighting.gain(time_s)[..., None] if lighting.changes else renderer.image
    return develop(total / np.float32(samples), rng)


def develop(light: FloatImage, rng: np.random.Generator) -> Image:
    """Linear light (H, W, 3) RGB to an 8-bit sRGB picture (H, W, 3) BGR with the sensor's noise."""
    clipped = np.clip(light, 0.0, 1.0)
    encoded = np.where(clipped < 0.0031308, 12.92 * clipped, 1.055 * clipped ** np.float32(1 / 2.4) - 0.055)
    noise = rng.standard_normal(light.shape, dtype=np.float32)
    return np.asarray(np.clip(np.rint(255.0 * encoded + _NOISE * noise), 0, 255)[..., ::-1], np.uint8)
