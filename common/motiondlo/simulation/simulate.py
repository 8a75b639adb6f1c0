"""Make a recording of a scene: motion, events, frames, calibration, truth."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from motiondlo.events.types import TRIGGER_DTYPE, EventArray, TriggerArray
from motiondlo.simulation.boards import belt_texture, board_texture
from motiondlo.simulation.cameras import Camera, calibrated_homography, draw_cameras, event_from_rgb
from motiondlo.simulation.dynamics import Motion, simulate_motion
from motiondlo.simulation.frames import EXPOSURE_US, develop, expose, trigger_times
from motiondlo.simulation.gripper import Part, gripper_parts, part_texture
from motiondlo.simulation.lighting import Lighting
from motiondlo.simulation.output import RecordingFolder, scene_document
from motiondlo.simulation.plan import Plan
from motiondlo.simulation.planning import make_plan
from motiondlo.simulation.renderer import Renderer
from motiondlo.simulation.scene import SceneParams
from motiondlo.simulation.seeding import Purpose, generator
from motiondlo.simulation.sensor import EventSensor, background_activity
from motiondlo.simulation.surroundings import see
from motiondlo.simulation.truth import ground_truth

# Between two images the fastest thing moves by no more than this, as long as the step is no shorter than the least.
_STEP_PX = 1.3
_LEAST_STEP_S = 0.0001
_MOST_STEP_S = 0.001
_LIGHT_STEP_S = 0.0005
_BELT_STEP_S = 0.0005
_SHARE_OF_MOTION, _SHARE_OF_EVENTS = 0.1, 0.8


@dataclass(frozen=True)
class Views:
    """Both cameras with their renderers."""

    event_camera: Camera
    rgb_camera: Camera
    event: Renderer
    rgb: Renderer


def simulate_recording(
    name: str, scene: SceneParams, seed: int, out: Path, progress: Callable[[float], None] = lambda share: None
) -> dict[str, Any]:
    """Write a recording to the new folder ``out``; the same scene and seed give the same files.

    Returns the statistics of ``scene.json``. Raises MotionDLOError when the folder exists or the scene cannot be made.
    """
    plan = make_plan(name, scene, seed)
    motion = simulate_motion(plan, lambda share: progress(_SHARE_OF_MOTION * share))
    folder = RecordingFolder(out)
    views = build_views(plan, motion)
    rng = generator(name, seed, Purpose.FRAMES)
    duration_us = int(plan.duration_s * 1e6)
    triggers = trigger_times(duration_us, rng)
    signal, events = _all_events(plan, motion, views, duration_us, progress)
    folder.write_events(events, _edges(triggers), views.event_camera)
    lighting = Lighting(plan, views.rgb_camera)
    frames_bytes = 0
    for i, start_us in enumerate(triggers):
        frames_bytes += folder.write_frame(i + 1, start_us, expose(views.rgb, lighting, start_us, rng))
        progress(_SHARE_OF_EVENTS + (1.0 - _SHARE_OF_EVENTS) * i / len(triggers))
    folder.write_image("background.jpg", develop(views.rgb.empty_board(0.0), rng))
    h_true = event_from_rgb(views.event_camera, views.rgb_camera)
    folder.write_calibration(*calibrated_homography(views.event_camera, views.rgb_camera, rng))
    truth = ground_truth(plan, motion, views.event_camera, views.event, h_true)
    folder.write_truth(truth)
    statistics = {
        "duration_s": plan.duration_s,
        "events": len(events),
        "signal_events": signal,
        "peak_meps_10ms": float(np.bincount(events["t"] // 10000).max() / 1e4) if len(events) else 0.0,
        "moving_s": float(truth["moving"].any(axis=0).mean() * plan.duration_s),
        "raw_mb": round((out / "events.raw").stat().st_size / 1e6, 2),
        "frames_mb": round(frames_bytes / 1e6, 2),
    }
    folder.write_json("manifest.json", {folder.frame_name(i + 1): t for i, t in enumerate(triggers)})
    cameras = (views.event_camera, views.rgb_camera)
    folder.write_camera_info(plan, cameras, float(truth["px_per_mm"]))
    folder.write_json("scene.json", scene_document(plan, motion, cameras, h_true, statistics))
    return statistics


def build_views(plan: Plan, motion: Motion) -> Views:
    """Both cameras' renderers, on the same board."""
    rng = generator(plan.name, plan.seed, Purpose.VIEWS)
    event_camera, rgb_camera = draw_cameras(rng)
    board = board_texture(plan.board, rng)
    belt = plan.scene.belt
    half = 1.0 if belt is None else belt.half_width_mm
    strip = None if belt is None else belt_texture(half, rng)
    textures = tuple(tuple(part_texture(part, rng) for part in gripper_parts(g)) for g in plan.grippers)
    plate = None
    if plan.plate is not None:
        plate = part_texture(Part(0.0, 0.0, plan.plate[3], plan.plate[4], 0.0, 0.38), rng)
    renderers = []
    for camera, colour in ((event_camera, False), (rgb_camera, True)):
        around = see(camera, board, colour, plan.belt_y_mm, half)
        renderers.append(Renderer(plan, motion, camera, around, textures, plate, strip))
    return Views(event_camera, rgb_camera, *renderers)


def _all_events(
    plan: Plan, motion: Motion, views: Views, duration_us: int, progress: Callable[[float], None]
) -> tuple[int, EventArray]:
    """Number of events of moving things, and all events in order."""
    lighting = Lighting(plan, views.event_camera)
    pieces = list(_signal(plan, views, lighting, duration_us, progress))
    signal = sum(len(piece) for piece in pieces)
    shape = (views.event_camera.height, views.event_camera.width)
    pieces.append(
        background_activity(plan.scene.sensor, shape, duration_us, generator(plan.name, plan.seed, Purpose.NOISE))
    )
    events = np.concatenate(pieces)
    events = events[(events["t"] >= 0) & (events["t"] < duration_us)]
    return signal, events[np.lexsort((events["x"], events["y"], events["t"]))]


def _signal(
    plan: Plan, views: Views, lighting: Lighting, duration_us: int, progress: Callable[[float], None]
) -> Iterator[EventArray]:
    renderer = views.event
    renderer.draw(0.0)
    rng = generator(plan.name, plan.seed, Purpose.PIXELS)
    sensor = EventSensor(plan.scene.sensor, renderer.image, lighting.gain(0.0), rng)
    everything = np.ones_like(renderer.draw(0.0))
    now_s, light_s, belt_s = 0.0, 0.0, 0.0
    end_s = duration_us * 1e-6
    gain = lighting.gain(0.0)
    while now_s < end_s:
        now_s += _step(renderer, now_s)
        with_belt = now_s - belt_s >= _BELT_STEP_S
        drawn = renderer.draw(now_s, with_belt)
        if with_belt:
            belt_s = now_s
        if lighting.changes and now_s - light_s >= _LIGHT_STEP_S:
            gain, drawn, light_s = lighting.gain(now_s), everything, now_s
        yield sensor.advance(renderer.image, gain, drawn, now_s * 1e6)
        progress(_SHARE_OF_MOTION + (_SHARE_OF_EVENTS - _SHARE_OF_MOTION) * now_s / end_s)


def _step(renderer: Renderer, now_s: float) -> float:
    """The next time step, s: short while something moves fast."""
    way = renderer.largest_step_px(now_s, now_s + _MOST_STEP_S)
    return float(np.clip(_MOST_STEP_S * _STEP_PX / max(way, 1e-9), _LEAST_STEP_S, _MOST_STEP_S))


def _edges(triggers: list[int]) -> TriggerArray:
    edges = np.zeros(2 * len(triggers), TRIGGER_DTYPE)
    edges["t"][0::2] = triggers
    edges["t"][1::2] = np.asarray(triggers, np.int64) + EXPOSURE_US
    edges["edge"][0::2] = 1
    return edges
