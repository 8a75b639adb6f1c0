"""The drivers of frame cameras, against device objects, and against the simulated producer that comes with genicam."""

from __future__ import annotations

import time
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import cv2
import numpy as np
import pytest

from motiondlo.cameras.config import FrameCameraSection
from motiondlo.cameras.genicam import GenICamCamera, configure, to_bgr
from motiondlo.cameras.interface import UNKNOWN, CameraLost, DriverMissing, Frame
from motiondlo.cameras.opencv import OpenCvCamera


class FakeCapture:
    """A ``cv2.VideoCapture`` of three frames, then unplugged."""

    def __init__(self, opens: bool = True, stamps_ms: float = 500.0) -> None:
        self.settings: dict[int, float] = {}
        self.released = False
        self._opens, self._stamps_ms, self._taken = opens, stamps_ms, 0

    def isOpened(self) -> bool:
        return self._opens

    def set(self, prop: int, value: float) -> None:
        self.settings[prop] = value

    def get(self, prop: int) -> float:
        assert prop == cv2.CAP_PROP_POS_MSEC
        return self._stamps_ms * self._taken

    def read(self) -> tuple[bool, Any]:
        self._taken += 1
        return (True, np.full((4, 6, 3), self._taken, np.uint8)) if self._taken <= 3 else (False, None)

    def release(self) -> None:
        self.released = True


def test_opencv_gives_each_frame_with_its_count_and_the_drivers_stamp() -> None:
    capture = FakeCapture()
    asked: list[tuple[Any, int]] = []

    def make(source: Any, backend: int) -> FakeCapture:
        asked.append((source, backend))
        return capture

    section = FrameCameraSection(driver="opencv", device="/dev/video2", width_px=2592, height_px=1944)
    camera = OpenCvCamera(section, make, now_ns=lambda: 77)
    camera.open()
    frames = [camera.read(0.1) for _ in range(3)]
    assert asked == [(2, cv2.CAP_V4L2)]
    assert capture.settings[cv2.CAP_PROP_FRAME_WIDTH] == 2592
    assert capture.settings[cv2.CAP_PROP_BUFFERSIZE] == 1, "no old frame waits in the driver"
    assert [(f.counter, f.device_ns, f.arrived_ns) for f in frames if f] == [
        (1, 500_000_000, 77),
        (2, 1_000_000_000, 77),
        (3, 1_500_000_000, 77),
    ]
    with pytest.raises(CameraLost, match="no frame"):
        camera.read(0.1)
    camera.close()
    assert capture.released


def test_opencv_without_stamps_or_without_a_device() -> None:
    camera = OpenCvCamera(FrameCameraSection(driver="opencv"), lambda *_: FakeCapture(stamps_ms=0.0))
    camera.open()
    frame = camera.read(0.1)
    assert frame is not None
    assert frame.device_ns == UNKNOWN
    gone = FakeCapture(opens=False)
    with pytest.raises(CameraLost, match="cannot be opened"):
        OpenCvCamera(FrameCameraSection(driver="opencv"), lambda *_: gone).open()
    assert gone.released


class Nodes:
    """A node map: takes what it has, in order; refuses the rest."""

    def __init__(self, *missing: str) -> None:
        self._missing = missing
        self.set: list[tuple[str, Any]] = []

    def get_node(self, name: str) -> Any:
        if name in self._missing:
            raise RuntimeError("Node not existing")
        nodes = self

        class Node:
            def __setattr__(self, key: str, value: Any) -> None:
                assert key == "value"
                nodes.set.append((name, value))

        return Node()


def test_genicam_sets_trigger_exposure_and_the_exposure_line_in_order() -> None:
    nodes = Nodes()
    configure(nodes, FrameCameraSection(driver="genicam", exposure_us=2500.0, gain_db=3.0, pixel_format="BayerRG8"))
    assert nodes.set == [
        ("PixelFormat", "BayerRG8"),
        ("TriggerSelector", "FrameStart"),
        ("TriggerMode", "On"),
        ("TriggerSource", "Line1"),
        ("TriggerActivation", "RisingEdge"),
        ("ExposureAuto", "Off"),
        ("ExposureTime", 2500.0),
        ("GainAuto", "Off"),
        ("Gain", 3.0),
        ("LineSelector", "Line2"),
        ("LineMode", "Output"),
        ("LineSource", "ExposureActive"),
    ]


def test_genicam_names_the_feature_that_a_camera_lacks() -> None:
    with pytest.raises(CameraLost, match="TriggerMode = 'On'"):
        configure(Nodes("TriggerMode"), FrameCameraSection(driver="genicam"))
    configure(Nodes("ExposureAuto", "LineMode", "TriggerSelector"), FrameCameraSection(driver="genicam"))


@pytest.mark.parametrize(
    ("pixel_format", "raw", "bgr"),
    [
        ("RGB8", [10, 20, 30] * 4, [30, 20, 10]),
        ("BGR8", [10, 20, 30] * 4, [10, 20, 30]),
        ("RGBa8", [10, 20, 30, 255] * 4, [30, 20, 10]),
        ("Mono8", [40] * 4, [40, 40, 40]),
    ],
)
def test_pixel_formats(pixel_format: str, raw: list[int], bgr: list[int]) -> None:
    image = to_bgr(np.array(raw, np.uint8), 2, 2, pixel_format)
    assert image.shape == (2, 2, 3)
    assert (image == bgr).all()


@pytest.mark.parametrize(("pixel_format", "red"), [("BayerRG8", (0, 0)), ("BayerBG8", (1, 1)), ("BayerGR8", (0, 1))])
def test_bayer_patterns_keep_red_red(pixel_format: str, red: tuple[int, int]) -> None:
    raw = np.zeros((8, 8), np.uint8)
    raw[red[0] :: 2, red[1] :: 2] = 200
    image = to_bgr(raw.reshape(-1), 8, 8, pixel_format)
    assert image[3, 3, 2] > 150
    assert image[..., :2].max() == 0


def test_an_image_cut_short_or_of_an_unknown_format_is_refused() -> None:
    with pytest.raises(CameraLost, match="11 bytes for 2x2 RGB8"):
        to_bgr(np.zeros(11, np.uint8), 2, 2, "RGB8")
    with pytest.raises(CameraLost, match="YUV422"):
        to_bgr(np.zeros(8, np.uint8), 2, 2, "YUV422_8")


class FakeHarvester:
    """Two devices."""

    def __init__(self) -> None:
        self.device_info_list = [
            SimpleNamespace(id_=f"cam{k}", serial_number=f"S{k}", access_status=1 if k else 4) for k in range(2)
        ]
        self.was_reset = False

    def add_file(self, path: str) -> None:
        assert path.endswith(".cti")

    def update(self) -> None:
        pass

    def reset(self) -> None:
        self.was_reset = True


def test_genicam_wants_one_device_to_be_named_among_several(tmp_path: Path) -> None:
    producer = tmp_path / "p.cti"
    producer.touch()
    harvester = FakeHarvester()
    camera = GenICamCamera(FrameCameraSection(driver="genicam", producer=str(producer)), lambda: harvester)
    assert [(d.serial, bool(d.problem)) for d in camera.find()] == [("S0", True), ("S1", False)]
    with pytest.raises(CameraLost, match="several"):
        camera.open()
    assert harvester.was_reset
    section = FrameCameraSection(driver="genicam", producer=str(producer), device="S7")
    with pytest.raises(CameraLost, match=r"no device 'S7'; there are: cam0 \(S0\), cam1 \(S1\)"):
        GenICamCamera(section, FakeHarvester).open()


def test_genicam_without_a_producer_says_where_it_looks(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("GENICAM_GENTL64_PATH", raising=False)
    with pytest.raises(CameraLost, match="no GenTL producer"):
        GenICamCamera(FrameCameraSection(driver="genicam"), FakeHarvester).open()


def test_a_missing_package_names_the_extra(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(__import__("sys").modules, "harvesters.core", None)
    with pytest.raises(DriverMissing, match=r"motiondlo\[live\]"):
        GenICamCamera(FrameCameraSection(driver="genicam"))


@pytest.fixture
def viky() -> Path:
    genicam = pytest.importorskip("genicam", reason='needs the extra "live"')
    pytest.importorskip("harvesters", reason='needs the extra "live"')
    path = Path(genicam.__file__).with_name("viky.cti")
    if not path.is_file():
        pytest.skip("this genicam wheel has no simulated producer")
    return path


def test_the_simulated_producer_gives_frames_that_count_up(viky: Path) -> None:
    section = FrameCameraSection(
        driver="genicam", producer=str(viky), device="1", trigger_source="", exposure_line="", pixel_format="RGBa8"
    )
    camera = GenICamCamera(section)
    assert len(camera.find()) == 3
    for _ in range(2):  # opened anew after it was closed
        camera.open()
        frames: list[Frame] = []
        deadline_s = time.monotonic() + 5.0
        while len(frames) < 3 and time.monotonic() < deadline_s:
            frame = camera.read(0.2)
            frames += [] if frame is None else [frame]
        camera.close()
        assert [f.counter - frames[0].counter for f in frames] == [0, 1, 2]
        assert all(f.image.shape == (400, 400, 3) for f in frames)
        arrivals = [f.arrived_ns for f in frames]
        assert arrivals == sorted(arrivals)
    with pytest.raises(CameraLost, match="not open"):
        camera.read(0.1)
    with pytest.raises(CameraLost, match="TriggerMode"):
        GenICamCamera(section.model_copy(update={"trigger_source": "Line1"})).open()
