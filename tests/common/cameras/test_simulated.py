"""Simulated cameras: a recording as a live cell, by a clock that the test moves."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from tests.common.cameras.fakes import Clock

from motiondlo.bundled import bundled_recording
from motiondlo.cameras import simulated_frames
from motiondlo.cameras.config import SimulatedSection
from motiondlo.cameras.interface import CameraLost, Frame
from motiondlo.cameras.simulated import Scene
from motiondlo.cameras.simulated_events import SimulatedEventCamera
from motiondlo.cameras.simulated_frames import SimulatedFrameCamera
from motiondlo.events.evt3 import Evt3Decoder
from motiondlo.events.joining import join
from motiondlo.events.reader import read_all
from motiondlo.events.types import SensorGeometry, TriggerArray
from motiondlo.recording.layout import Image

RISING = 1


def start_of_a_round(slow_motion: float = 1.0) -> float:
    scene = Scene(bundled_recording(), slow_motion)
    return 7 * scene.round_us * 1e-6


def watch_events(camera: SimulatedEventCamera, clock: Clock, seconds: float) -> tuple[int, TriggerArray, float]:
    """Number of events, triggers in the camera's clock, largest lateness of a piece, us."""
    decoder = Evt3Decoder(SensorGeometry())
    start_s, n, triggers, late_us = clock.s, 0, [], 0.0
    while clock.s < start_s + seconds:
        chunk = camera.read(0.02)
        assert chunk is not None, "a camera tells its time also when nothing happens"
        events, new = decoder.push(chunk.raw)
        n += len(events)
        triggers.append(new)
        late_us = max(late_us, chunk.arrived_ns / 1000 - start_s * 1e6 - decoder.time_us)
    assert not any(decoder.damage.values())
    return n, join(triggers), late_us


def test_events_are_the_recordings_at_their_pace_and_go_on_in_the_next_round() -> None:
    clock = Clock(start_of_a_round())
    camera = SimulatedEventCamera(SimulatedSection(), bundled_recording(), clock.ns, clock.sleep)
    camera.open()
    scene = Scene(bundled_recording(), 1.0)
    n, triggers, late_us = watch_events(camera, clock, 1.5 * scene.round_us * 1e-6)
    events, _ = read_all(bundled_recording() / "events.raw")
    assert n > 1.2 * len(events)
    assert late_us < 10_000
    assert decoded_without_damage(triggers)
    rising = triggers[triggers["edge"] == RISING]["t"]
    expected = [*scene.exposures_us, *(t + scene.round_us for t in scene.exposures_us)][: len(rising)]
    np.testing.assert_allclose(rising, expected, atol=2)


def decoded_without_damage(triggers: TriggerArray) -> bool:
    return bool((np.diff(triggers["t"]) > 0).all())


def test_frames_fit_the_triggers_of_the_event_camera_in_slow_motion() -> None:
    section = SimulatedSection(slow_motion=2.0, dropped_frames=(2,), dropped_triggers=(4,), frame_latency_ms=30.0)
    start_s = start_of_a_round(2.0)
    clock = Clock(start_s)
    camera = SimulatedEventCamera(section, bundled_recording(), clock.ns, clock.sleep)
    camera.open()
    _, triggers, _ = watch_events(camera, clock, 1.0)
    rising_us = triggers[triggers["edge"] == RISING]["t"].tolist()
    clock = Clock(start_s)
    frames_camera = SimulatedFrameCamera(section, bundled_recording(), clock.ns, clock.sleep)
    frames_camera.open()
    frames: list[Frame] = []
    while clock.s < start_s + 1.0:
        frame = frames_camera.read(0.05)
        frames += [] if frame is None else [frame]
    exposures_us = Scene(bundled_recording(), 2.0).exposures_us
    seen = [k for k, t in enumerate(exposures_us) if 0 < t < 960_000]
    by_counter = {f.counter: f for f in frames}
    assert exposures_us[4] not in rising_us
    first = seen[0]
    for k in seen:
        if k == 2:
            assert k - first + 1 not in by_counter
            continue
        frame = by_counter[k - first + 1]
        assert frame.device_ns == exposures_us[k] * 1000, "its clock started when it was opened"
        assert 29.99 <= frame.arrived_ns / 1e6 - start_s * 1e3 - exposures_us[k] / 1e3 < 31.0
        assert k == 4 or min(abs(t - exposures_us[k]) for t in rising_us) <= 2


@pytest.mark.parametrize("kind", [SimulatedEventCamera, SimulatedFrameCamera])
def test_UNPLUGGED_for_a_while(kind: type[SimulatedEventCamera] | type[SimulatedFrameCamera]) -> None:
    section = SimulatedSection(event_unplugged_s=((1.0, 2.0),), frame_unplugged_s=((1.0, 2.0),))
    clock = Clock(start_of_a_round())
    camera = kind(section, bundled_recording(), clock.ns, clock.sleep)
    camera.open()
    clock.sleep(1.2)
    with pytest.raises(CameraLost, match="unplugged"):
        camera.read(0.0)
    with pytest.raises(CameraLost, match="unplugged"):
        camera.open()
    clock.sleep(1.0)
    camera.open()
    deadline_s = clock.s + 0.5
    while camera.read(0.1) is None:
        assert clock.s < deadline_s


def test_a_frame_arrives_when_it_is_due_however_long_its_file_takes(monkeypatch: pytest.MonkeyPatch) -> None:
    clock = Clock(start_of_a_round(4.0))

    def slow(path: Path) -> Image:
        clock.s += 0.06
        return np.zeros((4, 4, 3), np.uint8)

    monkeypatch.setattr(simulated_frames, "read_image", slow)
    section = SimulatedSection(slow_motion=4.0, frame_latency_ms=25.0)
    camera = SimulatedFrameCamera(section, bundled_recording(), clock.ns, clock.sleep)
    opened_us = round(clock.s * 1e6)
    camera.open()
    lateness_us = []
    while len(lateness_us) < 4:
        frame = camera.read(0.02)
        if frame is not None:
            lateness_us.append(frame.arrived_ns // 1000 - opened_us - frame.device_ns // 1000)
    # A first exposure right after the camera was opened is the one that may be late.
    assert max(lateness_us[1:]) < 27_000
