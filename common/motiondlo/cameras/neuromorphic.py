"""Event cameras by USB through ``neuromorphic-drivers`` (Prophesee EVK4 and others with an IMX636)."""

from __future__ import annotations

import time
from contextlib import suppress
from types import ModuleType
from typing import Any

from motiondlo.cameras.config import EventCameraSection
from motiondlo.cameras.interface import Camera, CameraLost, DriverMissing, EventChunk, FoundDevice

POLL_S = 0.02
"""The driver's own wait, fixed when the device is opened; ``read`` adds up several."""
EVK4 = "prophesee_evk4"


class NeuromorphicCamera(Camera[EventChunk]):
    """The EVT3 bytes of one device, in the driver's raw mode: decoding and damage are handled as in recordings."""

    def __init__(self, section: EventCameraSection, driver: ModuleType | Any | None = None) -> None:
        """driver: the package, imported when None. Raises DriverMissing."""
        self._section = section
        self._driver: Any = _import_driver() if driver is None else driver
        self._device: Any = None
        self._dropped = 0
        self.name = f"event camera {section.serial}".strip()

    def open(self) -> None:
        """Connect and configure: biases, external trigger input on, rate limit. Raises CameraLost."""
        section = self._section
        family = getattr(self._driver, EVK4)
        limiter = None
        if section.max_events_per_ms:
            limiter = family.RateLimiter(reference_period_us=1000, maximum_events_per_period=section.max_events_per_ms)
        configuration = family.Configuration(
            biases=family.Biases(diff_on=section.bias_diff_on, diff_off=section.bias_diff_off),
            enable_external_trigger=True,
            rate_limiter=limiter,
        )
        try:
            self._device = self._driver.open(
                configuration=configuration, iterator_timeout=POLL_S, raw=True, serial=section.serial or None
            )
            self._device.__enter__()
        except Exception as error:  # the driver raises bare RuntimeErrors
            self._device = None
            raise CameraLost(f"cannot be opened ({error})", "Is it plugged in, and may this user open it?") from error
        self._dropped = 0

    def read(self, timeout_s: float) -> EventChunk | None:
        """The next packet. Raises CameraLost."""
        if self._device is None:
            raise CameraLost("is not open")
        deadline_ns = time.monotonic_ns() + int(timeout_s * 1e9)
        while True:
            try:
                status, packet = next(self._device)
            except StopIteration:
                raise CameraLost("the driver has stopped") from None
            except Exception as error:  # USB errors come as bare RuntimeErrors
                raise CameraLost(f"unplugged or failed ({error})") from error
            now_ns = time.monotonic_ns()
            if packet is not None and len(packet):
                total = 0 if status.ring is None else status.ring.dropped_packets
                lost, self._dropped = max(total - self._dropped, 0), total
                return EventChunk(bytes(packet), now_ns, lost)
            if now_ns >= deadline_ns:
                return None

    def close(self) -> None:
        """Release the device."""
        device, self._device = self._device, None
        if device is not None:
            with suppress(Exception):  # it is gone already: nothing is left to be released
                device.__exit__(None, None, None)

    def find(self) -> list[FoundDevice]:
        """The devices on this machine. Raises CameraLost where USB itself cannot be used."""
        try:
            devices = self._driver.list_devices()
        except Exception as error:
            raise CameraLost(f"USB cannot be searched ({error})") from error
        return [FoundDevice(str(d.name.value), d.serial or "", d.error or "") for d in devices]


def _import_driver() -> Any:
    try:
        import neuromorphic_drivers
    except ImportError as error:
        raise DriverMissing(
            "The driver neuromorphic needs the package neuromorphic-drivers.", 'pip install "motiondlo[live]"'
        ) from error
    return neuromorphic_drivers
