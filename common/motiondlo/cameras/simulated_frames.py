"""An RGB camera that is not there: the frames of a recording, each after its exposure, with the faults wanted."""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path

from motiondlo.cameras.config import SimulatedSection
from motiondlo.cameras.interface import Camera, CameraLost, FoundDevice, Frame
from motiondlo.cameras.simulated import Plug, Scene
from motiondlo.recording.layout import Image, read_image


class SimulatedFrameCamera(Camera[Frame]):
    """Counter and clock start anew whenever it is opened, as a real camera's do."""

    name = "simulated RGB camera"

    def __init__(
        self,
        section: SimulatedSection,
        recording: Path,
        now_ns: Callable[[], int] = time.monotonic_ns,
        sleep: Callable[[float], None] = time.sleep,
    ) -> None:
        """Raises RecordingError."""
        self._scene = Scene(recording, section.slow_motion)
        self._latency_us = round(section.frame_latency_ms * 1000)
        self._dropped = frozenset(section.dropped_frames)
        self._plug = Plug(section.frame_unplugged_s, now_ns)
        self._now_ns, self._sleep = now_ns, sleep
        self._opened_us: int | None = None
        self._taken_us = 0
        self._counter = 0
        self._image: tuple[int, Image | None] | None = None
        """Number and picture of the next exposure: a camera's frame arrives, it is not read from a file."""

    def open(self) -> None:
        """Raises CameraLost while it is unplugged."""
        self._plug.check()
        self._opened_us = self._taken_us = self._now_ns() // 1000
        self._counter = 0

    def read(self, timeout_s: float) -> Frame | None:
        """The next frame when it has arrived. Raises CameraLost."""
        if self._opened_us is None:
            raise CameraLost("is not open")
        self._plug.check()
        number, exposure_us = self._next_exposure()
        if self._image is None or self._image[0] != number:
            self._image = number, read_image(self._scene.recording.frames[number].path)
        wait_s = (exposure_us + self._latency_us) * 1e-6 - self._now_ns() * 1e-9
        if wait_s > 0:
            self._sleep(min(wait_s, timeout_s))
            if wait_s > timeout_s:
                return None
        self._taken_us = exposure_us
        self._counter += 1
        if number in self._dropped:
            return None
        image = self._image[1]
        if image is None:
            return None
        return Frame(image, self._now_ns(), self._counter, (exposure_us - self._opened_us) * 1000)

    def close(self) -> None:
        """Stop."""
        self._opened_us = None

    def find(self) -> list[FoundDevice]:
        """Itself."""
        return [FoundDevice("simulated", self._scene.recording.name)]

    def _next_exposure(self) -> tuple[int, int]:
        """Number in its round, and host time, us, of the exposure after the last one taken."""
        round_number, since_us = self._scene.round_of(self._taken_us * 1000)
        start_us = round_number * self._scene.round_us
        for number, t_us in enumerate(self._scene.exposures_us):
            if t_us > since_us:
                return number, start_us + t_us
        return 0, start_us + self._scene.round_us + self._scene.exposures_us[0]
