"""Every decoder of bytes from outside: sound inputs to damage, and what must hold whatever comes of them."""

from __future__ import annotations

import io
import json
from collections.abc import Callable
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
from tests.common.events.encoding import plain_evt2_words, plain_evt21_words, random_events
from tests.common.messages.examples import EXPECT, STAMP, all_messages

from motiondlo.config.loader import load_section
from motiondlo.errors import CalibrationError, ConfigError, RecordingError
from motiondlo.events.evt2 import Evt2Decoder, Evt21Decoder
from motiondlo.events.evt3 import Evt3Decoder
from motiondlo.events.raw_header import parse_raw_header
from motiondlo.events.stream_decoder import StreamDecoder
from motiondlo.events.types import EventArray, SensorGeometry, TriggerArray, empty_triggers
from motiondlo.events.writer import Evt3Encoder, evt3_header
from motiondlo.geometry.homography import load_homography
from motiondlo.messages.reject import Rejected
from motiondlo.messages.schemas import MODELS
from motiondlo.recording.layout import open_recording
from motiondlo.security.certificates import init, issue_holder
from motiondlo.security.folder import CertificateFolder
from motiondlo.security.inspection import inspect
from motiondlo_services.cell_config import check_configuration
from motiondlo_services.fusion.config import FusionConfig

SENSOR = SensorGeometry(640, 480)
INT64_MAX = (1 << 63) - 1
NOW = datetime(2030, 5, 1, tzinfo=UTC)


@dataclass(frozen=True)
class Target:
    """One decoder."""

    name: str
    seeds: Callable[[Path], list[bytes]]
    """Sound inputs; the folder is for what lies beside them."""
    check: Callable[[bytes, Path], None]
    """Decode, refuse as documented, or fail the test."""


def _stream(make: Callable[[], StreamDecoder]) -> Callable[[bytes, Path], None]:
    def check(data: bytes, _: Path) -> None:
        whole, pieces = make(), make()
        events, triggers = _decoded(whole, [data])
        announced = -1
        collected = []
        for i in range(0, len(data), 331):
            part, _ = pieces.push(data[i : i + 331])
            assert not len(part) or part["t"][0] >= announced, "older than what was announced"
            assert pieces.time_us >= announced
            announced = pieces.time_us
            collected.append(part)
        collected.append(pieces.flush()[0])
        np.testing.assert_array_equal(np.concatenate(collected), events)
        assert pieces.damage == whole.damage
        for array in (events, triggers):
            assert not len(array) or (array["t"][0] >= 0 and (np.diff(array["t"]) >= 0).all())
        if len(events):
            assert events["x"].max() < SENSOR.width_px
            assert events["y"].max() < SENSOR.height_px
        assert len(events) <= 12 * (len(data) // 2 + 1), "no word holds more"

    return check


def _decoded(decoder: StreamDecoder, chunks: list[bytes]) -> tuple[EventArray, TriggerArray]:
    parts = [decoder.push(chunk) for chunk in chunks] + [decoder.flush()]
    events, triggers = zip(*parts, strict=True)
    return np.concatenate(events), np.concatenate(triggers)


def _events(seed: int) -> EventArray:
    return random_events(60, seed=seed, mean_step_us=40.0, width=SENSOR.width_px, height=SENSOR.height_px)


def _raw_header(data: bytes, _: Path) -> None:
    try:
        header = parse_raw_header(data)
    except RecordingError:
        return
    assert 0 <= header.size_bytes <= len(data)
    assert header.geometry is None or header.geometry.width_px > 0


def _message(data: bytes, _: Path) -> None:
    for model in MODELS.values():
        try:
            message = model.from_bytes(data, EXPECT)
        except Rejected:
            continue
        assert message.cell == "cell1"
        assert message.t_us <= 3_000_000, "not from the future"
        # What is let in can be sent on, and comes back the same.
        assert model.from_bytes(message.to_bytes(STAMP), EXPECT).t_us == message.t_us


def _manifest(data: bytes, folder: Path) -> None:
    (folder / "manifest.json").write_bytes(data)
    try:
        recording = open_recording(folder)
    except RecordingError:
        return
    times_us = [entry.t_us for entry in recording.frames]
    assert times_us == sorted(times_us)
    assert all(0 <= t_us <= INT64_MAX for t_us in times_us)
    assert all(entry.path.parent == folder / "frames" for entry in recording.frames)


def _manifest_seeds(folder: Path) -> list[bytes]:
    (folder / "frames").mkdir()
    (folder / "events.raw").touch()
    names = [f"frame_{i:06d}.jpg" for i in range(4)]
    for name in names:
        (folder / "frames" / name).touch()
    return [json.dumps(dict(zip(names, range(0, 400_000, 100_000), strict=True))).encode(), b"[" * 3000]


def _camera_info(data: bytes, folder: Path) -> None:
    (folder / "camera_info.json").write_bytes(data)
    try:
        info = open_recording(folder).camera_info
    except RecordingError:
        return
    assert info.px_per_mm is None or info.px_per_mm > 0


def _camera_info_seeds(folder: Path) -> list[bytes]:
    (folder / "events.raw").touch()
    return [json.dumps({"px_per_mm": 5.4, "rgb_size": [2592, 1944]}).encode(), b'{"px_per_mm": 1}']


def _homography(data: bytes, folder: Path) -> None:
    path = folder / "H.npy"
    path.write_bytes(data)
    try:
        matrix = load_homography(path)
    except CalibrationError:
        return
    assert matrix.shape == (3, 3)
    assert np.isfinite(np.linalg.inv(matrix)).all()


def _homography_seeds(_: Path) -> list[bytes]:
    seeds = []
    for dtype in ("<f8", "<f4", "<i4"):
        file = io.BytesIO()
        np.save(file, np.array([[2, 0, 5], [0, 2, 7], [0, 0, 1]], dtype))
        seeds.append(file.getvalue())
    archive = io.BytesIO()
    np.savez(archive, h=np.eye(3))
    return [*seeds, archive.getvalue()]


def _configuration(data: bytes, folder: Path) -> None:
    path = folder / "cell.toml"
    path.write_bytes(data)
    try:
        cell = check_configuration(path)
    except ConfigError:
        return
    assert cell.cell.name
    load_section(path, "fusion", FusionConfig)


def _configuration_seeds(_: Path) -> list[bytes]:
    root = Path(__file__).resolve().parents[2]
    small = b'[cell]\nname = "c"\n[gate]\nvisitors = ["monitor"]\n[bus]\nfirst_port = 20000\n'
    small += b'[bus.endpoints]\nfusion = "tcp/[::1]:1"\n'
    return [(root / "config" / "replay.toml").read_bytes(), small, b"a = " + b"[" * 3000]


def _certificate(data: bytes, folder: Path) -> None:
    certs = CertificateFolder(folder / "certs")
    certs.certificate("monitor").write_bytes(data)
    for complaint in inspect(certs, ["monitor"], NOW):
        assert complaint.what_to_do


def _certificate_seeds(folder: Path) -> list[bytes]:
    certs = CertificateFolder(folder / "certs")
    init(certs, "c", NOW)
    issue_holder(certs, "monitor", "", NOW)
    return [certs.certificate("monitor").read_bytes(), certs.key("monitor").read_bytes()]


TARGETS = (
    Target(
        "evt2",
        lambda _: [plain_evt2_words(_events(seed), empty_triggers()) for seed in range(4)],
        _stream(lambda: Evt2Decoder(SENSOR)),
    ),
    Target(
        "evt2.1",
        lambda _: [plain_evt21_words(_events(seed)) for seed in range(4)],
        _stream(lambda: Evt21Decoder(SENSOR)),
    ),
    Target(
        "evt3",
        lambda _: [Evt3Encoder(SENSOR).encode(_events(seed)) for seed in range(4)],
        _stream(lambda: Evt3Decoder(SENSOR)),
    ),
    Target("raw header", lambda _: [evt3_header(SENSOR), b"% format EVT21;endianness=little\n% end\n"], _raw_header),
    Target("messages", lambda _: [message.to_bytes(STAMP) for message in all_messages().values()], _message),
    Target("manifest", _manifest_seeds, _manifest),
    Target("camera info", _camera_info_seeds, _camera_info),
    Target("homography", _homography_seeds, _homography),
    Target("configuration", _configuration_seeds, _configuration),
    Target("certificates", _certificate_seeds, _certificate),
)
