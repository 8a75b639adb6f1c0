"""Images of linear light at any time, drawn anew only where something has moved."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.interpolate import CubicSpline

from motiondlo.geometry.curve import left_normals, tangents
from motiondlo.simulation import boards
from motiondlo.simulation.cameras import Camera
from motiondlo.simulation.dynamics import Motion
from motiondlo.simulation.gripper import Part, Texture, box_px, gripper_parts, part_centres
from motiondlo.simulation.plan import CablePlan, Plan
from motiondlo.simulation.raster_kernels import (
    REACH,
    TILE,
    draw_belt,
    draw_box,
    mark_box,
    mark_points,
    nearest_on_tube,
    restore_tiles,
    shade_tube,
    shadow_tube,
)
from motiondlo.simulation.surroundings import AMBIENT, LUMINANCE, Surroundings, light_direction

FloatArray = npt.NDArray[np.float64]
FloatImage = npt.NDArray[np.float32]
Tiles = npt.NDArray[np.uint8]

SHADOW = 0.35
METAL = (0.99, 1.0, 1.03)
# Below this nobody sees that something moved.
_STILL_PX = 0.02
_CABLE, _BOX = 0, 1


@dataclass(frozen=True)
class Box:
    """A part of a gripper or the plate, as seen now."""

    shape_px: FloatArray
    """(6,) centre x, y, angle, half length, half width, texels' scale."""
    shadow_px: FloatArray
    """(6,) likewise, of its shadow on the board."""
    softness_px: float
    texture: Texture


@dataclass
class _Drawn:
    """One thing as it was drawn last."""

    points: FloatArray
    tiles: Tiles


class Renderer:
    """Draws one camera's view of a motion."""

    def __init__(
        self,
        plan: Plan,
        motion: Motion,
        camera: Camera,
        surroundings: Surroundings,
        textures: tuple[tuple[Texture, ...], ...],
        plate_texture: Texture | None,
        belt: Texture | None,
    ) -> None:
        self._plan, self._motion, self._camera = plan, motion, camera
        self._around, self._textures, self._plate_texture, self._belt = surroundings, textures, plate_texture, belt
        h, w, channels = surroundings.board.shape
        self._tile_shape = (-(-h // TILE), -(-w // TILE))
        self._belt_tiles = self._tiles_of_belt()
        self._light = light_direction()
        half = self._light + np.array([0.0, 0.0, 1.0])
        self._half = half / np.linalg.norm(half)
        self._parts: tuple[tuple[Part, ...], ...] = tuple(gripper_parts(g) for g in plan.grippers)
        self._looks = [_look(cable) for cable in plan.cables]
        self._colours = [_colour(cable, channels) for cable in plan.cables]
        self._tint = np.asarray(METAL if channels == 3 else (1.0,), np.float64)
        self._finer = [_refinement(cable, camera) for cable in plan.cables]
        self._hit = np.zeros((h, w), np.int32)
        self._place, self._across, self._beyond = (np.zeros((h, w), np.float32) for _ in range(3))
        self._touched = np.zeros(h * w, np.int32)
        self._drawn: dict[tuple[int, int], _Drawn] = {}
        self.image: FloatImage = surroundings.board.copy()
        """(H, W, C) linear light, valid after the first call of ``draw``."""

    def largest_step_px(self, t0_s: float, t1_s: float) -> float:
        """How far the fastest thing in the plan moves between two times."""
        scale = float(self._camera.scale(np.array(3.0)))
        moves = [np.abs(self._motion.chain(k, t1_s) - self._motion.chain(k, t0_s)).max() for k in self._movable()]
        for g, parts in enumerate(self._parts):
            before, after = self._motion.gripper(g, t0_s), self._motion.gripper(g, t1_s)
            moves.append(np.hypot(*(after - before)[:2]) + 80.0 * abs(after[2] - before[2]) * bool(parts))
        return scale * float(max(moves, default=0.0)) * 1.2

    def draw(self, time_s: float, with_belt: bool = True) -> Tiles:
        """Bring the image to ``time_s``; returns the tiles (H / TILE, W / TILE) that were drawn anew."""
        cables = [self._cable_points(k, time_s) for k in range(len(self._plan.cables))]
        boxes = self.boxes(time_s)
        dirty = np.zeros(self._tile_shape, np.uint8)
        for k, (points, heights, radii) in enumerate(cables):
            self._mark(
                (_CABLE, k), points, dirty, lambda tiles, p=points, z=heights, r=radii: self._mark_tube(tiles, p, z, r)
            )
        for b, box in enumerate(boxes):
            corner = np.append(box.shape_px[:2], box.shape_px[2] * 100.0)
            self._mark((_BOX, b), corner[None], dirty, lambda tiles, box=box: self._mark_box(tiles, box))
        if self._belt is not None and with_belt:
            dirty |= self._belt_tiles
        if not dirty.any():
            return dirty
        self._draw_ground(time_s, dirty)
        order = sorted(range(len(cables)), key=lambda k: (self._plan.cables[k].support_mm, k))
        for k in order:
            self._draw_cable(k, *cables[k], dirty)
        self._draw_boxes(boxes, dirty)
        return dirty

    def empty_board(self, time_s: float) -> FloatImage:
        """(H, W, C) linear light of the board with what belongs to the cell: belt and plate, no cables, no grippers."""
        everywhere = np.ones(self._tile_shape, np.uint8)
        self._draw_ground(time_s, everywhere)
        self._draw_boxes(self.boxes(time_s)[: int(self._plan.plate is not None)], everywhere)
        self._drawn.clear()
        return self.image.copy()

    def boxes(self, time_s: float) -> list[Box]:
        """The plate, if there is one, then the parts of all grippers, lower ones first within each."""
        found: list[Box] = []
        plate, scene = self._plan.plate, self._plan.scene
        if plate is not None and scene.plate is not None and self._plate_texture is not None:
            centre = np.array([plate[0], plate[1], scene.plate.height_mm])
            found.append(self._box(centre, plate[2], (plate[3], plate[4]), self._plate_texture))
        for g, parts in enumerate(self._parts):
            pose = self._motion.gripper(g, time_s)
            held_mm = max((c.chain_mm[0, 2] for c in self._plan.cables if c.gripper == g), default=3.0)
            for part, centre, texture in zip(
                parts, part_centres(parts, pose, float(held_mm)), self._textures[g], strict=True
            ):
                found.append(self._box(centre, float(pose[2]), (part.half_length_mm, part.half_width_mm), texture))
        return found

    def _box(self, centre: FloatArray, angle: float, half_mm: tuple[float, float], texture: Texture) -> Box:
        ground = centre - self._light / self._light[2] * centre[2]
        return Box(
            box_px(self._camera, centre, angle, half_mm),
            box_px(self._camera, ground, angle, half_mm),
            1.5 + 0.3 * float(centre[2]),
            texture,
        )

    def _movable(self) -> list[int]:
        return [k for k, cable in enumerate(self._plan.cables) if cable.dynamic]

    def _cable_points(self, k: int, time_s: float) -> tuple[FloatArray, FloatArray, FloatArray]:
        fine = self._finer[k] @ self._motion.chain(k, time_s)
        radii = 0.5 * self._plan.cables[k].diameter_mm * self._camera.scale(fine[:, 2])
        return self._camera.project(fine), fine, radii

    def _mark(self, key, points: FloatArray, dirty: Tiles, mark) -> None:  # type: ignore[no-untyped-def]
        last = self._drawn.get(key)
        if last is not None and np.abs(points - last.points).max() < _STILL_PX:
            return
        tiles = np.zeros(self._tile_shape, np.uint8)
        mark(tiles)
        dirty |= tiles
        if last is not None:
            dirty |= last.tiles
        self._drawn[key] = _Drawn(points, tiles)

    def _mark_tube(self, tiles: Tiles, points: FloatArray, fine: FloatArray, radii: FloatArray) -> None:
        gap = float(np.hypot(*np.diff(points, axis=0).T).max())
        mark_points(tiles, points, radii + 0.5 * gap + REACH * self._camera.blur_px + 1.0)
        shadow, softness = self._shadow(fine)
        mark_points(tiles, shadow, radii + 0.5 * gap + REACH * softness + 1.0)

    def _mark_box(self, tiles: Tiles, box: Box) -> None:
        mark_box(tiles, box.shape_px, REACH * self._camera.blur_px + 1.0)
        mark_box(tiles, box.shadow_px, REACH * box.softness_px + 1.0)

    def _shadow(self, fine: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Where the axis casts its shadow (N, 2) px, and how soft that is (N,) px."""
        ground = fine - self._light / self._light[2] * fine[:, 2:]
        return self._camera.project(ground), 1.2 + 0.25 * fine[:, 2]

    def _draw_cable(self, k: int, points: FloatArray, fine: FloatArray, radii: FloatArray, dirty: Tiles) -> None:
        hits = (self._hit, self._place, self._across, self._beyond, self._touched)
        cable = self._plan.cables[k]
        arcs = np.linspace(0.0, cable.length_mm, len(points))
        shadow, softness = self._shadow(fine)
        heights = np.ascontiguousarray(fine[:, 2])
        n = nearest_on_tube(dirty, shadow, radii, heights, arcs, REACH * float(softness.max()), *hits)
        shadow_tube(self.image, radii, softness, SHADOW, *hits, n)
        normals = left_normals(tangents(points))
        blur = self._camera.blur_px
        n = nearest_on_tube(dirty, points, radii, heights, arcs, REACH * blur, *hits)
        shade_tube(
            self.image, self._around.light_map, points, normals, radii, arcs, self._colours[k], self._looks[k],
            self._light, self._half, blur, *hits, n,
        )  # fmt: skip

    def _draw_ground(self, time_s: float, dirty: Tiles) -> None:
        restore_tiles(self.image, self._around.board, dirty)
        if self._belt is not None and self._plan.scene.belt is not None:
            a = self._around
            shift = self._plan.scene.belt.speed_mm_s * time_s
            draw_belt(
                self.image, a.light_map, dirty, a.belt_across, a.belt_along, a.belt_inside, self._belt, shift,
                float(boards.TEXELS_PER_MM),
            )  # fmt: skip

    def _draw_boxes(self, boxes: list[Box], dirty: Tiles) -> None:
        for box in boxes:
            draw_box(
                self.image, self._around.light_map, dirty, box.shadow_px, box.texture, self._tint, box.softness_px,
                SHADOW,
            )  # fmt: skip
        for box in boxes:
            draw_box(
                self.image, self._around.light_map, dirty, box.shape_px, box.texture, self._tint,
                self._camera.blur_px, 0.0,
            )  # fmt: skip

    def _tiles_of_belt(self) -> Tiles:
        tiles = np.zeros(self._tile_shape, np.uint8)
        if self._belt is not None:
            y, x = np.nonzero(self._around.belt_inside > 0.002)
            tiles[y // TILE, x // TILE] = 1
        return tiles


def _look(cable: CablePlan) -> FloatArray:
    m = cable.material
    return np.array(
        [cable.diameter_mm, m.spec, m.shine, AMBIENT, m.noise, m.noise_mm, m.print_amp, m.print_period_mm,
         m.print_len_mm, m.clear, float(m.seed)]
    )  # fmt: skip


def _colour(cable: CablePlan, channels: int) -> FloatArray:
    rgb = np.asarray(cable.material.rgb)
    return rgb if channels == 3 else np.array([float(rgb @ np.asarray(LUMINANCE))])


def _refinement(cable: CablePlan, camera: Camera) -> FloatArray:
    """(N, S + 1) matrix from the chain's vertices to points about 4 px apart on the spline through them."""
    vertices = len(cable.chain_mm)
    count = max(vertices, round(cable.length_mm * float(camera.scale(np.array(3.0))) / 4.0))
    spline = CubicSpline(np.arange(vertices), np.eye(vertices), bc_type="natural")
    return np.asarray(spline(np.linspace(0.0, vertices - 1.0, count)))
