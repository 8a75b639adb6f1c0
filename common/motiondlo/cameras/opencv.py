"""Frame cameras through OpenCV: V4L2 devices, network streams, video files."""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from motiondlo.cameras.config import FrameCameraSection
from motiondlo.cameras.interface import UNKNOWN, Camera, CameraLost, FoundDevice, Frame


class OpenCvCamera(Camera[Frame]):
    """One ``cv2.VideoCapture``. V4L2 stamps buffers with its own clock, which serves as the camera's."""

    def __init__(
        self,
        section: FrameCameraSection,
        capture: Callable[[Any, int], Any] = cv2.VideoCapture,
        now_ns: Callable[[], int] = time.monotonic_ns,
    ) -> None:
        """capture: makes the capture from a device and an OpenCV backend."""
        self._section = section
        self._make = capture
        self._now_ns = now_ns
        self._capture: Any = None
        self._counter = 0
        self.name = f"RGB camera {section.device or '/dev/video0'}"

    def open(self) -> None:
        """Connect; one buffer only, so that no old frame waits in the driver. Raises CameraLost."""
        device = self._section.device or "0"
        number = device.removeprefix("/dev/video")
        source: str | int = int(number) if number.isdigit() else device
        capture = self._make(source, cv2.CAP_V4L2 if isinstance(source, int) else cv2.CAP_ANY)
        if not capture.isOpened():
            capture.release()
            raise CameraLost("cannot be opened", "Is it plugged in, and may this user open it?")
        capture.set(cv2.CAP_PROP_BUFFERSIZE, 1)
        for prop, value in (
            (cv2.CAP_PROP_FRAME_WIDTH, self._section.width_px),
            (cv2.CAP_PROP_FRAME_HEIGHT, self._section.height_px),
        ):
            if value:
                capture.set(prop, value)
        self._capture, self._counter = capture, 0

    def read(self, timeout_s: float) -> Frame | None:
        """The next frame; OpenCV waits for it as long as V4L2 does, whatever ``timeout_s``. Raises CameraLost."""
        if self._capture is None:
            raise CameraLost("is not open")
        taken, image = self._capture.read()
        if not taken or image is None:
            raise CameraLost("gives no frame")
        arrived_ns = self._now_ns()
        self._counter += 1
        stamp_ms = float(self._capture.get(cv2.CAP_PROP_POS_MSEC))
        return Frame(
            image=np.asarray(image, dtype=np.uint8),
            arrived_ns=arrived_ns,
            counter=self._counter,
            device_ns=int(stamp_ms * 1e6) if stamp_ms > 0.0 else UNKNOWN,
        )

    def close(self) -> None:
        """Release the device."""
        capture, self._capture = self._capture, None
        if capture is not None:
            capture.release()

    def find(self) -> list[FoundDevice]:
        """The video devices of this machine."""
        found = []
        for path in sorted(Path("/dev").glob("video*")):
            try:
                path.open("rb").close()
            except OSError as error:
                found.append(FoundDevice(str(path), "", error.strerror or "cannot be opened"))
            else:
                found.append(FoundDevice(str(path), ""))
        return found
