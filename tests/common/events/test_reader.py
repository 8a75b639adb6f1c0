"""Event files: written here, real ones, simulated ones, and broken ones."""

from __future__ import annotations

import json
import tracemalloc
from pathlib import Path

import numpy as np
import pytest
from tests.common.events.encoding import make_triggers, plain_evt2_words, random_events

from motiondlo.errors import RecordingError
from motiondlo.events.joining import join
from motiondlo.events.raw_header import EventFormat
from motiondlo.events.reader import open_events, read_all
from motiondlo.events.types import SensorGeometry
from motiondlo.events.writer import Evt3Writer, crop_recording_events, evt3_header

SENSOR = SensorGeometry(640, 480)


@pytest.fixture
def raw(tmp_path: Path) -> Path:
    """5000 events and 4 triggers in 50 ms."""
    path = tmp_path / "events.raw"
    with Evt3Writer(path, SENSOR) as writer:
        events = random_events(5000, mean_step_us=10.0, width=640, height=480)
        writer.write(events[:1234], make_triggers([(10, 0, 1), (200, 0, 0)]))
        writer.write(events[1234:], make_triggers([(20_000, 0, 1), (25_000, 0, 0)]))
    return path


def test_what_was_written_is_read(raw: Path) -> None:
    events, triggers = read_all(raw)
    np.testing.assert_array_equal(events, random_events(5000, mean_step_us=10.0, width=640, height=480))
    assert triggers.tolist() == [(10, 0, 1), (200, 0, 0), (20_000, 0, 1), (25_000, 0, 0)]
    source = open_events(raw)
    assert (source.format, source.geometry) == (EventFormat.EVT3, SENSOR)


def test_batches_hold_everything_and_can_be_read_again(raw: Path) -> None:
    source = open_events(raw)
    for _ in range(2):
        batches = list(source.batches(5000))
        assert [b.t0_us for b in batches] == list(range(0, batches[-1].t1_us, 5000))
        np.testing.assert_array_equal(join([b.events for b in batches]), read_all(raw)[0])
        assert [len(b.triggers) for b in batches[:6]] == [2, 0, 0, 0, 1, 1]
    assert source.damage == {}


def test_geometry_comes_from_the_header_then_the_caller_then_the_sensor(tmp_path: Path, raw: Path) -> None:
    assert open_events(raw, SensorGeometry(100, 100)).geometry == SENSOR
    bare = tmp_path / "bare.raw"
    bare.write_bytes(b"% evt 3.0\n\x00\x80")
    assert open_events(bare).geometry == SensorGeometry(1280, 720)
    assert open_events(bare, SENSOR).geometry == SENSOR
    bare.write_bytes(b"% evt 2.0\n% plugin_name hal_plugin_gen3_fx3\n")
    assert open_events(bare).geometry == SENSOR


@pytest.mark.parametrize("content", [b"", b"no header", b"% Date today\n", b"% evt 9.0\n", b"\x00" * 5000])
def test_what_is_no_event_file_is_refused_by_name(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "events.raw"
    path.write_bytes(content)
    with pytest.raises(RecordingError, match=r"events\.raw"):
        open_events(path)


def test_a_missing_file_is_refused_by_name(tmp_path: Path) -> None:
    with pytest.raises(RecordingError, match=r"nowhere\.raw"):
        open_events(tmp_path / "nowhere.raw")


def test_a_header_without_data_gives_nothing(tmp_path: Path) -> None:
    path = tmp_path / "events.raw"
    path.write_bytes(evt3_header(SENSOR))
    assert list(open_events(path).batches()) == []
    assert [len(part) for part in read_all(path)] == [0, 0]


def test_evt2_files_are_recognised(tmp_path: Path) -> None:
    path = tmp_path / "events.raw"
    events = random_events(500, width=640, height=480)
    path.write_bytes(b"% evt 2.0\n% geometry 640x480\n% end\n" + plain_evt2_words(events, make_triggers([])))
    np.testing.assert_array_equal(read_all(path)[0], events)


def test_damage_is_reported_with_all_events_before_it(tmp_path: Path, raw: Path) -> None:
    path = tmp_path / "damaged.raw"
    data = raw.read_bytes()
    path.write_bytes(data[:9000] + b"\x00\x90" + data[9002:-1])
    source = open_events(path)
    damaged = join([b.events for b in source.batches()])
    sound = read_all(raw)[0]
    before = int((sound["t"] < 10_000).sum())
    np.testing.assert_array_equal(damaged[:before], sound[:before])
    assert len(damaged) > 4900
    assert source.damage["reserved_word"] == 1
    assert source.damage["truncated_bytes"] == 1


def test_cropping_shifts_time_to_zero(tmp_path: Path, raw: Path) -> None:
    out = tmp_path / "cropped.raw"
    written = crop_recording_events(raw, out, 15_000, 30_000)
    sound = read_all(raw)[0]
    expected = sound[(sound["t"] >= 15_000) & (sound["t"] < 30_000)].copy()
    expected["t"] -= 15_000
    events, triggers = read_all(out)
    np.testing.assert_array_equal(events, expected)
    assert written == len(expected)
    assert triggers.tolist() == [(5000, 0, 1), (10_000, 0, 0)]
    with pytest.raises(ValueError, match="empty span"):
        crop_recording_events(raw, out, 5, 5)


def test_memory_does_not_grow_with_the_file(tmp_path: Path) -> None:
    path = tmp_path / "events.raw"
    events = random_events(200_000, width=640, height=480)
    with Evt3Writer(path, SENSOR) as writer:
        for lap in range(6):
            later = events.copy()
            later["t"] += lap * 1_000_000
            writer.write(later)
    source = open_events(path)
    sum(len(b.events) for b in source.batches())
    tracemalloc.start()
    total = sum(len(b.events) for b in source.batches())
    peak_bytes = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert total == 1_200_000
    # buffers are reserved for the worst case; the 19 MB of events are never held at once
    assert peak_bytes < 14e6


@pytest.mark.shared_data
@pytest.mark.parametrize(
    ("name", "kind", "sensor", "count"),
    [
        ("evt3_gen41_evk3.raw", EventFormat.EVT3, SensorGeometry(), 219_596),
        ("evt2_gen3.raw", EventFormat.EVT2, SENSOR, 539_481),
        ("evt2_gen3_b.raw", EventFormat.EVT2, SENSOR, 521_252),
    ],
)
def test_real_recordings(shared_data: Path, name: str, kind: EventFormat, sensor: SensorGeometry, count: int) -> None:
    source = open_events(shared_data / "real" / name)
    batches = list(source.batches())
    events = join([b.events for b in batches])
    assert (source.format, source.geometry, source.damage) == (kind, sensor, {})
    assert len(events) == count
    assert (np.diff(events["t"]) >= 0).all()
    assert batches[0].t0_us <= events["t"][0] < batches[0].t1_us


@pytest.mark.shared_data
@pytest.mark.parametrize("name", ["single_dlo1_speed5", "drag"])
def test_simulated_recordings_have_the_events_and_triggers_that_were_simulated(shared_data: Path, name: str) -> None:
    folder = shared_data / name
    scene = json.loads((folder / "scene.json").read_text())
    manifest = json.loads((folder / "manifest.json").read_text())
    events, triggers = read_all(folder / "events.raw")
    assert len(events) == scene["statistics"]["events"]
    rising_us = triggers["t"][triggers["edge"] == 1]
    assert rising_us.tolist() == pytest.approx(sorted(manifest.values()), abs=30)
    assert (triggers["t"][triggers["edge"] == 0] - rising_us).tolist() == pytest.approx([5000] * len(rising_us), abs=30)
