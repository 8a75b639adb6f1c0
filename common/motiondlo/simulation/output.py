"""Write a recording's files in the documented layout."""

from __future__ import annotations

import json
from dataclasses import asdict
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from motiondlo.errors import MotionDLOError
from motiondlo.events.types import EventArray, SensorGeometry, TriggerArray
from motiondlo.events.writer import Evt3Writer
from motiondlo.simulation.cameras import WORK_PLANE_MM, Camera, FloatArray
from motiondlo.simulation.dynamics import Motion
from motiondlo.simulation.frames import EXPOSURE_US, PERIOD_US, Image
from motiondlo.simulation.plan import Plan
from motiondlo.simulation.renderer import SHADOW
from motiondlo.simulation.surroundings import LIGHT

_JPEG_QUALITY = 93


class RecordingFolder:
    """A new folder that becomes a recording."""

    def __init__(self, path: Path) -> None:
        """Make the folder. Raises MotionDLOError when it holds something already, or cannot be made."""
        self._path = path
        try:
            if path.exists() and any(path.iterdir()):
                raise MotionDLOError(f"{path}: is not empty.", "Choose another folder.")
            (path / "frames").mkdir(parents=True)
            (path / "homography").mkdir()
        except OSError as error:
            raise MotionDLOError(f"{path}: cannot be made ({error.strerror}).", "Choose another folder.") from error

    @staticmethod
    def frame_name(number: int) -> str:
        """File name of the frame with this number, from 1."""
        return f"frame_{number:06d}.jpg"

    def write_events(self, events: EventArray, triggers: TriggerArray, camera: Camera) -> None:
        """events.raw."""
        with Evt3Writer(self._path / "events.raw", SensorGeometry(camera.width, camera.height)) as writer:
            writer.write(events, triggers)

    def write_frame(self, number: int, start_us: int, image: Image) -> int:
        """One frame; returns its size in bytes."""
        return self.write_image(f"frames/{self.frame_name(number)}", image)

    def write_image(self, name: str, image: Image) -> int:
        """A JPEG; returns its size in bytes."""
        data = cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, _JPEG_QUALITY])[1].tobytes()
        (self._path / name).write_bytes(data)
        return len(data)

    def write_calibration(self, h: FloatArray, rgb_px: FloatArray, event_px: FloatArray) -> None:
        """The fitted homography and the points that it was fitted to."""
        np.save(self._path / "homography" / "rgb_to_event_H.npy", h)
        np.savez(self._path / "homography" / "calibration_points.npz", rgb_px=rgb_px, event_px=event_px)

    def write_truth(self, truth: dict[str, Any]) -> None:
        """ground_truth.npz."""
        np.savez_compressed(self._path / "ground_truth.npz", **truth)

    def write_camera_info(self, plan: Plan, cameras: tuple[Camera, Camera], px_per_mm: float) -> None:
        """camera_info.json."""
        event, rgb = ({"width": camera.width, "height": camera.height} for camera in cameras)
        self.write_json(
            "camera_info.json",
            {
                "event": event,
                "rgb": rgb,
                "px_per_mm": round(px_per_mm, 4),
                "diameters_mm": [cable.diameter_mm for cable in plan.cables],
            },
        )

    def write_json(self, name: str, document: dict[str, Any]) -> None:
        """A JSON file."""
        (self._path / name).write_text(json.dumps(document, indent=1) + "\n", encoding="utf-8")


def scene_document(
    plan: Plan, motion: Motion, cameras: tuple[Camera, Camera], h_true: FloatArray, statistics: dict[str, Any]
) -> dict[str, Any]:
    """``scene.json``: how the recording was made."""
    speeds = [np.hypot(*np.gradient(pose[:, :2], 0.0005, axis=0).T) for pose in motion.grippers]
    event, rgb = (asdict(camera) for camera in cameras)
    return {
        "scene": plan.name,
        "seed": plan.seed,
        "duration_s": plan.duration_s,
        "background": plan.board,
        "cables": [
            {
                "name": cable.name,
                "diameter_mm": cable.diameter_mm,
                "length_mm": cable.length_mm,
                "kg_per_m": cable.kg_per_m,
                "bending_n_m2": cable.bending_n_m2,
                "friction": cable.friction,
                "rgb": list(cable.material.rgb),
                "gripper": cable.gripper,
                "loose": cable.loose,
                "support_mm": cable.support_mm,
            }
            for cable in plan.cables
        ],
        "materials": [asdict(cable.material) for cable in plan.cables],
        "primary": 0,
        "strokes": [[asdict(stroke) for stroke in gripper.strokes] for gripper in plan.grippers],
        "clock": "event camera, microseconds",
        "trigger_channel": 0,
        "rgb_exposure_us": EXPOSURE_US,
        "rgb_fps": round(1e6 / PERIOD_US),
        "work_plane_mm": WORK_PLANE_MM,
        "H_rgb_to_event_true": h_true.tolist(),
        "tcp_median_mm_s": [float(np.median(speed[speed > 5.0])) if (speed > 5.0).any() else 0.0 for speed in speeds],
        "tcp_max_mm_s": [float(speed.max()) for speed in speeds],
        "sensor": plan.scene.sensor.model_dump(),
        "event_camera": event,
        "rgb_camera": rgb,
        "plate": plan.plate,
        "belt": None if plan.scene.belt is None else {"y0_mm": plan.belt_y_mm, **plan.scene.belt.model_dump()},
        "flicker": None
        if plan.scene.flicker is None
        else {"spot_mm": plan.flicker_spot_mm, **plan.scene.flicker.model_dump()},
        "flash": None if plan.scene.flash is None else plan.scene.flash.model_dump(),
        "light": LIGHT,
        "shadow": SHADOW,
        "statistics": statistics,
    }
