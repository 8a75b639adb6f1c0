"""The driver of event cameras, against a device object with the package's interface and real EVT3 bytes."""

from __future__ import annotations

from collections.abc import Iterator
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from tests.common.events.encoding import make_triggers, random_events

from motiondlo.cameras.config import EventCameraSection
from motiondlo.cameras.interface import CameraLost, DriverMissing
from motiondlo.cameras.neuromorphic import NeuromorphicCamera
from motiondlo.events.evt3 import Evt3Decoder
from motiondlo.events.joining import join
from motiondlo.events.types import SensorGeometry
from motiondlo.events.writer import Evt3Encoder

SENSOR = SensorGeometry()


class FakeDevice:
    """Yields packets as a device in raw mode does; after the last it fails as an unplugged one does."""

    def __init__(self, packets: list[tuple[bytes | None, int]]) -> None:
        self._packets = iter(packets)
        self.closed = False

    def __enter__(self) -> FakeDevice:
        return self

    def __exit__(self, *_: object) -> None:
        self.closed = True

    def __iter__(self) -> Iterator[Any]:
        return self

    def __next__(self) -> tuple[Any, bytes | None]:
        for packet, dropped in self._packets:
            ring = None if packet is None else SimpleNamespace(dropped_packets=dropped)
            return SimpleNamespace(ring=ring), packet
        raise RuntimeError("No such device (it may have been disconnected)")


class FakeDriver:
    """The package."""

    def __init__(self, device: FakeDevice | None) -> None:
        self.device = device
        self.arguments: dict[str, Any] = {}
        self.prophesee_evk4 = SimpleNamespace(
            Biases=SimpleNamespace,
            RateLimiter=SimpleNamespace,
            Configuration=SimpleNamespace,
        )

    def open(self, **arguments: Any) -> FakeDevice:
        self.arguments = arguments
        if self.device is None:
            raise RuntimeError("device not found")
        return self.device

    def list_devices(self) -> list[Any]:
        name = SimpleNamespace(value="Prophesee EVK4")
        return [SimpleNamespace(name=name, serial="00051501", error=None)]


def test_bytes_decode_to_the_events_that_were_sent() -> None:
    events = random_events(4000, mean_step_us=5.0)
    data = Evt3Encoder(SENSOR).encode(events, make_triggers([(7000, 0, 1), (12_000, 0, 0)]))
    packets: list[tuple[bytes | None, int]] = [(data[i : i + 4001], 0) for i in range(0, len(data), 4001)]
    packets.insert(1, (None, 0))
    camera = NeuromorphicCamera(EventCameraSection(driver="neuromorphic"), FakeDriver(FakeDevice(packets)))
    camera.open()
    decoder, parts = Evt3Decoder(SENSOR), []
    chunks = [camera.read(0.0) for _ in packets]
    with pytest.raises(CameraLost, match="disconnected"):
        camera.read(0.0)
    parts += [decoder.push(chunk.raw) for chunk in chunks if chunk is not None]
    parts.append(decoder.flush())
    np.testing.assert_array_equal(join([part[0] for part in parts]), events)
    assert join([part[1] for part in parts])["t"].tolist() == [7000, 12_000]


def test_dropped_packets_are_told_once() -> None:
    device = FakeDevice([(b"aa", 0), (b"bb", 3), (b"cc", 3)])
    camera = NeuromorphicCamera(EventCameraSection(driver="neuromorphic"), FakeDriver(device))
    camera.open()
    assert [camera.read(0.0).lost_packets for _ in range(3)] == [0, 3, 0]  # type: ignore[union-attr]
    camera.close()
    assert device.closed
    camera.close()


def test_the_configuration_reaches_the_device() -> None:
    section = EventCameraSection(
        driver="neuromorphic", serial="00051501", bias_diff_on=12, bias_diff_off=-5, max_events_per_ms=20_000
    )
    driver = FakeDriver(FakeDevice([]))
    NeuromorphicCamera(section, driver).open()
    configuration = driver.arguments["configuration"]
    assert driver.arguments["raw"] is True
    assert driver.arguments["serial"] == "00051501"
    assert (configuration.biases.diff_on, configuration.biases.diff_off) == (12, -5)
    assert configuration.enable_external_trigger
    assert configuration.rate_limiter.maximum_events_per_period == 20_000


def test_no_device_is_a_camera_that_may_come() -> None:
    with pytest.raises(CameraLost, match="device not found"):
        NeuromorphicCamera(EventCameraSection(), FakeDriver(None)).open()


def test_the_real_package_has_the_interface_that_is_used() -> None:
    nd = pytest.importorskip("neuromorphic_drivers", reason='needs the extra "live"')
    family = nd.prophesee_evk4
    configuration = family.Configuration(
        biases=family.Biases(diff_on=1, diff_off=1),
        enable_external_trigger=True,
        rate_limiter=family.RateLimiter(reference_period_us=1000, maximum_events_per_period=1),
    )
    assert configuration.serialize()
    camera = NeuromorphicCamera(EventCameraSection(serial="no such camera"))
    with pytest.raises(CameraLost):
        camera.open()


def test_a_missing_package_names_the_extra(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(__import__("sys").modules, "neuromorphic_drivers", None)
    with pytest.raises(DriverMissing, match=r"motiondlo\[live\]"):
        NeuromorphicCamera(EventCameraSection())
