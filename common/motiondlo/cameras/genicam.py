"""Frame cameras of the GenICam standard (GigE Vision, USB3 Vision, CoaXPress) through ``harvesters``."""

from __future__ import annotations

import os
import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from motiondlo.cameras.config import FrameCameraSection
from motiondlo.cameras.interface import UNKNOWN, Camera, CameraLost, DriverMissing, FoundDevice, Frame, Image

PATH_VARIABLE = "GENICAM_GENTL64_PATH"
EVENT_WAIT_MS = 20
"""How long the producer waits for a frame before it looks at the clock."""

# Pixel format: channels of the raw image, conversion to BGR (None: it is BGR).
_CONVERSIONS: dict[str, tuple[int, int | None]] = {
    "Mono8": (1, cv2.COLOR_GRAY2BGR),
    "RGB8": (3, cv2.COLOR_RGB2BGR),
    "RGB8Packed": (3, cv2.COLOR_RGB2BGR),
    "BGR8": (3, None),
    "BGR8Packed": (3, None),
    "RGBa8": (4, cv2.COLOR_RGBA2BGR),
    "BGRa8": (4, cv2.COLOR_BGRA2BGR),
    "BayerRG8": (1, cv2.COLOR_BayerRGGB2BGR),
    "BayerBG8": (1, cv2.COLOR_BayerBGGR2BGR),
    "BayerGR8": (1, cv2.COLOR_BayerGRBG2BGR),
    "BayerGB8": (1, cv2.COLOR_BayerGBRG2BGR),
}


class GenICamCamera(Camera[Frame]):
    """One device of one GenTL producer; trigger, exposure and the exposure-active line are set when it is opened."""

    def __init__(
        self,
        section: FrameCameraSection,
        harvester: Callable[[], Any] | None = None,
        now_ns: Callable[[], int] = time.monotonic_ns,
    ) -> None:
        """harvester: makes the ``Harvester``; imported when None. Raises DriverMissing."""
        self._section = section
        self._make = _import_harvester() if harvester is None else harvester
        self._now_ns = now_ns
        self._harvester: Any = None
        self._acquirer: Any = None
        self.name = f"RGB camera {section.device}".strip()

    def open(self) -> None:
        """Connect, configure, start. Raises CameraLost, also for a feature that the camera does not have."""
        try:
            self._harvester = self._search()
            key = self._choose()
            self._acquirer = self._harvester.create(key)
            self._acquirer.timeout_period_on_update_event_data_call = EVENT_WAIT_MS
            configure(self._acquirer.remote_device.node_map, self._section)
            self._acquirer.start()
        except CameraLost:
            self.close()
            raise
        except Exception as error:  # producers raise their own
            self.close()
            raise CameraLost(
                f"cannot be opened ({error})", "Is it plugged in, and is no other program using it?"
            ) from error

    def read(self, timeout_s: float) -> Frame | None:
        """The next complete frame. Raises CameraLost."""
        if self._acquirer is None:
            raise CameraLost("is not open")
        try:
            buffer = self._acquirer.try_fetch(timeout=timeout_s)
            if buffer is None:
                return None
            arrived_ns = self._now_ns()
            with buffer:
                part = buffer.payload.components[0]
                image = to_bgr(np.asarray(part.data), part.width, part.height, str(part.data_format))
                return Frame(image, arrived_ns, int(buffer.module.frame_id), _device_ns(buffer))
        except CameraLost:
            raise
        except Exception as error:  # producers raise their own
            raise CameraLost(f"unplugged or failed ({error})") from error

    def close(self) -> None:
        """Stop, release the device and the producer."""
        acquirer, self._acquirer = self._acquirer, None
        harvester, self._harvester = self._harvester, None
        for step in (
            *((acquirer.stop, acquirer.destroy) if acquirer is not None else ()),
            *((harvester.reset,) if harvester is not None else ()),
        ):
            with suppress(Exception):  # a device that is gone cannot be stopped, yet the rest must be released
                step()

    def find(self) -> list[FoundDevice]:
        """The devices that the producer sees. Raises CameraLost."""
        try:
            harvester = self._search()
        except CameraLost:
            raise
        except Exception as error:
            raise CameraLost(f"the producer failed ({error})") from error
        try:
            return [_found(info) for info in harvester.device_info_list]
        finally:
            harvester.reset()

    def _search(self) -> Any:
        producers = find_producers(self._section.producer)
        if not producers:
            raise CameraLost(
                "no GenTL producer (.cti) was found",
                f"Install the camera maker's, and name it in [cameras.frame] producer or {PATH_VARIABLE}.",
            )
        harvester = self._make()
        for producer in producers:
            harvester.add_file(str(producer))
        harvester.update()
        return harvester

    def _choose(self) -> int:
        """Index of the configured device."""
        devices = [_found(info) for info in self._harvester.device_info_list]
        wanted = self._section.device
        hits = [k for k, device in enumerate(devices) if not wanted or wanted in (device.serial, device.name)]
        if not hits:
            seen = ", ".join(f"{device.name} ({device.serial})" for device in devices) or "none"
            raise CameraLost(f"no device {wanted!r}; there are: {seen}".replace(" ''", ""), "Is it plugged in?")
        if len(hits) > 1:
            raise CameraLost("several devices are there", "Name one in [cameras.frame] device.")
        return hits[0]


def find_producers(named: str) -> list[Path]:
    """The named producer, or all those on GENICAM_GENTL64_PATH."""
    if named:
        path = Path(named).expanduser()
        return [path] if path.is_file() else []
    folders = [Path(part) for part in os.environ.get(PATH_VARIABLE, "").split(os.pathsep) if part]
    return sorted(path for folder in folders if folder.is_dir() for path in folder.glob("*.cti"))


def configure(nodes: Any, section: FrameCameraSection) -> None:
    """Set the camera's features. Raises CameraLost naming the feature that the camera lacks or refuses."""
    settings: list[tuple[str, Any]] = []
    if section.pixel_format:
        settings.append(("PixelFormat", section.pixel_format))
    if section.trigger_source:
        settings += [
            ("TriggerSelector", "FrameStart"),
            ("TriggerMode", "On"),
            ("TriggerSource", section.trigger_source),
            ("TriggerActivation", section.trigger_activation),
            ("ExposureAuto", "Off"),
            ("ExposureTime", section.exposure_us),
        ]
    if section.gain_db:
        settings += [("GainAuto", "Off"), ("Gain", section.gain_db)]
    if section.exposure_line:
        settings += [
            ("LineSelector", section.exposure_line),
            ("LineMode", "Output"),
            ("LineSource", "ExposureActive"),
        ]
    for name, value in settings:
        try:
            nodes.get_node(name).value = value
        except Exception as error:
            if name in _OPTIONAL:
                continue
            raise CameraLost(
                f"does not take {name} = {value!r} ({error})", "Correct [cameras.frame], or use another camera."
            ) from error


_OPTIONAL = {"TriggerSelector", "ExposureAuto", "GainAuto", "LineMode"}
"""Features that simpler cameras leave out because only one value makes sense."""


def to_bgr(data: Image, width_px: int, height_px: int, pixel_format: str) -> Image:
    """(height, width, 3) uint8 BGR of a raw image. Raises CameraLost for a format that is not known, or cut short."""
    if pixel_format not in _CONVERSIONS:
        raise CameraLost(
            f"sends {pixel_format}", f"Set [cameras.frame] pixel_format to one of {', '.join(_CONVERSIONS)}."
        )
    channels, code = _CONVERSIONS[pixel_format]
    if data.size != width_px * height_px * channels:
        raise CameraLost(f"sent {data.size} bytes for {width_px}x{height_px} {pixel_format}")
    image = data.reshape((height_px, width_px, channels) if channels > 1 else (height_px, width_px))
    return np.array(image if code is None else cv2.cvtColor(image, code), dtype=np.uint8)


def _found(info: Any) -> FoundDevice:
    usable = int(info.access_status) in (0, 1)  # unknown, readable and writable
    name = str(info.id_)
    return FoundDevice(
        name, str(info.serial_number or ""), "" if usable else "in use by another program, or not permitted"
    )


def _device_ns(buffer: Any) -> int:
    """The camera's time stamp, UNKNOWN where it has none (or gives zeros)."""
    ticks = int(buffer.timestamp)
    return ticks * 1_000_000_000 // int(buffer.timestamp_frequency) if ticks > 0 else UNKNOWN


def _import_harvester() -> Any:
    try:
        from harvesters.core import Harvester
    except ImportError as error:
        raise DriverMissing(
            "The driver genicam needs the package harvesters.", 'pip install "motiondlo[live]"'
        ) from error
    return Harvester
