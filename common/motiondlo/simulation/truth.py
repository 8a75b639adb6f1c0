"""The exact truth of a simulated recording, in the documented layout."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.interpolate import CubicSpline
from scipy.ndimage import binary_closing

from motiondlo.simulation.cameras import WORK_PLANE_MM, Camera
from motiondlo.simulation.dynamics import Motion
from motiondlo.simulation.plan import Plan
from motiondlo.simulation.renderer import Renderer

FloatArray = npt.NDArray[np.float64]

NODES = 100
VISIBILITY = ("visible", "outside", "gripper", "cable", "plate")
_MOVING_MM_S = 20.0
_CLOSED_GAP_MS = 30


def ground_truth(plan: Plan, motion: Motion, camera: Camera, renderer: Renderer, h_true: FloatArray) -> dict[str, Any]:
    """Arrays of ``ground_truth.npz``, every 1 ms from 0."""
    times_us = np.arange(int(plan.duration_s * 1000) + 1, dtype=np.int64) * 1000
    resample = [_resampling(len(cable.chain_mm)) for cable in plan.cables]
    k_count, t_count = len(plan.cables), len(times_us)
    world = np.zeros((k_count, t_count, NODES, 3))
    boxes = []
    for t, t_us in enumerate(times_us):
        for k in range(k_count):
            world[k, t] = resample[k] @ motion.chain(k, t_us * 1e-6)
        boxes.append([box.shape_px for box in renderer.boxes(t_us * 1e-6)])
    nodes = camera.project(world)
    boxes_px = np.asarray(boxes).reshape(t_count, -1, 6)
    inside = np.asarray(((nodes >= -0.5) & (nodes < [camera.width - 0.5, camera.height - 0.5])).all(axis=-1))
    speed = _speeds(world, inside, plan)
    moving = np.stack([_close_gaps(row > _MOVING_MM_S) for row in speed])
    return {
        "times_us": times_us,
        "nodes": nodes.astype(np.float32),
        "height_mm": world[..., 2].astype(np.float32),
        "visibility": _visibility(plan, world, nodes, inside, boxes_px, camera),
        "visibility_names": np.asarray(VISIBILITY),
        "moving": moving,
        "speed_mm_s": speed.astype(np.float32),
        "px_per_mm": np.float64(camera.scale(np.array(WORK_PLANE_MM))),
        "diameters_mm": np.asarray([cable.diameter_mm for cable in plan.cables]),
        "names": np.asarray([cable.name for cable in plan.cables]),
        "primary": np.int64(0),
        "moved": moving.any(axis=1),
        "boxes_px": boxes_px.astype(np.float32),
        "plate": np.bool_(plan.plate is not None),
        "width": np.int64(camera.width),
        "height": np.int64(camera.height),
        "H_true": h_true,
    }


def _resampling(vertices: int) -> FloatArray:
    spline = CubicSpline(np.arange(vertices), np.eye(vertices), bc_type="natural")
    return np.asarray(spline(np.linspace(0.0, vertices - 1.0, NODES)))


def _speeds(world: FloatArray, inside: npt.NDArray[np.bool_], plan: Plan) -> FloatArray:
    """(K, T) mm/s of the fastest node in the image."""
    speed = np.linalg.norm(np.gradient(world, 0.001, axis=1), axis=-1)
    speed[[not cable.dynamic for cable in plan.cables]] = 0.0
    return np.asarray(np.where(inside, speed, 0.0).max(axis=-1))


def _close_gaps(moving: npt.NDArray[np.bool_]) -> npt.NDArray[np.bool_]:
    padded = np.pad(moving, _CLOSED_GAP_MS)
    closed = binary_closing(padded, np.ones(_CLOSED_GAP_MS, bool))
    return np.asarray(closed[_CLOSED_GAP_MS:-_CLOSED_GAP_MS] | moving)


def _visibility(
    plan: Plan,
    world: FloatArray,
    nodes: FloatArray,
    inside: npt.NDArray[np.bool_],
    boxes_px: FloatArray,
    camera: Camera,
) -> npt.NDArray[np.uint8]:
    k_count, t_count = nodes.shape[:2]
    found = np.zeros(nodes.shape[:3], np.uint8)
    first_gripper = 1 if plan.plate is not None else 0
    order = sorted(range(k_count), key=lambda k: (plan.cables[k].support_mm, k))
    rank = {k: place for place, k in enumerate(order)}
    scale = float(camera.scale(np.array(WORK_PLANE_MM)))
    arcs = [np.linspace(0.0, cable.length_mm, NODES) for cable in plan.cables]
    for k in range(k_count):
        for other in range(k_count):
            reach = 0.5 * plan.cables[other].diameter_mm * scale
            if other == k or rank[other] > rank[k]:
                apart = np.abs(np.subtract.outer(arcs[k], arcs[k])) > 25.0 if other == k else None
                for t in range(t_count):
                    found[k, t][_under(nodes[k, t], world[k, t], nodes[other, t], world[other, t], reach, apart)] = 3
        for b in range(boxes_px.shape[1]):
            covered = _in_boxes(nodes[k], boxes_px[:, b])
            found[k][covered] = 4 if b < first_gripper else 2
    found[~inside] = 1
    return found


def _under(
    nodes: FloatArray,
    world: FloatArray,
    other: FloatArray,
    other_world: FloatArray,
    reach_px: float,
    apart: npt.NDArray[np.bool_] | None,
) -> npt.NDArray[np.bool_]:
    """(N,) nodes that lie under the other cable's axis, within its radius."""
    low, high = other.min(axis=0) - reach_px, other.max(axis=0) + reach_px
    near = ((nodes >= low) & (nodes <= high)).all(axis=1)
    hidden = np.zeros(len(nodes), bool)
    if not near.any():
        return hidden
    rows = np.flatnonzero(near)
    steps = np.diff(other, axis=0)
    rel = nodes[rows, None] - other[None, :-1]
    u = np.clip((rel * steps).sum(-1) / np.maximum((steps**2).sum(-1), 1e-12), 0.0, 1.0)
    close = np.linalg.norm(rel - u[..., None] * steps, axis=-1) < reach_px
    if apart is not None:
        close &= apart[rows][:, :-1] & (other_world[None, :-1, 2] > world[rows, None, 2])
    hidden[rows] = close.any(axis=1)
    return hidden


def _in_boxes(nodes: FloatArray, boxes: FloatArray) -> npt.NDArray[np.bool_]:
    """(T, N): nodes (T, N, 2) inside a box (T, 6) of the same time."""
    rel = nodes - boxes[:, None, :2]
    c, s = np.cos(boxes[:, None, 2]), np.sin(boxes[:, None, 2])
    u, v = c * rel[..., 0] + s * rel[..., 1], -s * rel[..., 0] + c * rel[..., 1]
    return np.asarray((np.abs(u) < boxes[:, None, 3]) & (np.abs(v) < boxes[:, None, 4]))
