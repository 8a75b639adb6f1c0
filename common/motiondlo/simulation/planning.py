"""Make the choices that a scene leaves open: shapes, places, movements, looks. Everything follows from the seed."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from motiondlo.errors import MotionDLOError
from motiondlo.geometry.curve import distance_to_curve
from motiondlo.simulation.boards import BOARD_RGB
from motiondlo.simulation.curves import (
    angle_profile,
    bump,
    crossings,
    curve_from_angles,
    loop_profile,
    smooth_step,
)
from motiondlo.simulation.materials import MECHANICS, draw_material, scaled_mechanics
from motiondlo.simulation.plan import CablePlan, GripperPlan, Plan
from motiondlo.simulation.scene import CableParams, GripperParams, SceneParams
from motiondlo.simulation.seeding import Purpose, generator
from motiondlo.simulation.strokes import Stroke

FloatArray = npt.NDArray[np.float64]

SEGMENT_MM = 4.5
# Half the view of the event camera, mm.
HALF_VIEW_MM = (118.5, 66.5)
_TRIES = 1000
_TRIES_PER_SHAPE = 20
_GAP_MM = 5.0


def make_plan(name: str, scene: SceneParams, seed: int) -> Plan:
    """Every choice made. Raises MotionDLOError when the cables do not find room in the view."""
    rng = generator(name, seed, Purpose.PLAN)
    speed = scene.speed_mm_s if scene.speed_mm_s is not None else float(np.exp(rng.uniform(np.log(90), np.log(1500))))
    board = scene.board or tuple(BOARD_RGB)[int(rng.integers(len(BOARD_RGB)))]
    grippers: list[GripperPlan] = []
    best: tuple[float, list[FloatArray], list[GripperPlan]] | None = None
    for attempt in range(_TRIES):
        if attempt % _TRIES_PER_SHAPE == 0:
            shapes = [_draw_shape(cable, _neighbours(cable, scene), rng) for cable in scene.cables]
        grippers = [_draw_gripper(index, scene, shapes, speed, rng) for index in range(len(scene.grippers))]
        curves = _lay_out(scene, shapes, grippers, rng)
        score = _score(scene, curves, grippers)
        if best is None or score > best[0]:
            best = (score, curves, grippers)
        if score >= 0.0:
            break
    if best is None or best[0] <= -0.5:
        raise MotionDLOError(
            f"{name}: no room in the view for all cables (seed {seed}).", "Try another seed, or shorter cables."
        )
    _, curves, grippers = best
    chains = _raise_over_crossings(scene, curves)
    cables = tuple(_cable_plan(index, scene, chain, board, rng) for index, chain in enumerate(chains))
    end_s = max((s.start_s + s.duration_s for g in grippers for s in g.strokes), default=scene.rest_before_s)
    return Plan(
        name=name,
        seed=seed,
        scene=scene,
        board=board,
        duration_s=round(end_s + scene.rest_after_s, 3),
        cables=cables,
        grippers=tuple(grippers),
        plate=_place_plate(scene, chains[0], grippers, rng),
        belt_y_mm=_belt_place(chains[0], grippers, rng),
        flicker_spot_mm=(float(rng.uniform(-40.0, 40.0)), float(rng.uniform(-25.0, 25.0))),
    )


def _neighbours(cable: CableParams, scene: SceneParams) -> int:
    """How many cables its gripper holds, itself included."""
    return max(1, sum(cable.gripper >= 0 and other.gripper == cable.gripper for other in scene.cables))


def _draw_shape(cable: CableParams, neighbours: int, rng: np.random.Generator) -> tuple[float, FloatArray]:
    """Length and tangent angles (S,) relative to the direction at the start; cables held side by side bend less."""
    low, high = MECHANICS[cable.kind].length_mm
    shape = cable.shape
    if shape == "any":
        shape = ("straight", "arc", "arc", "wave")[int(rng.integers(4))]
    if cable.gripper < 0 and not cable.loose:
        low, high = 190.0, 225.0
    if cable.loose:
        low, high = 85.0, 125.0
    if shape == "loop":
        low, high = 250.0, 290.0
    length = cable.length_mm if cable.length_mm is not None else float(rng.uniform(low, high))
    count = max(8, round(length / SEGMENT_MM))
    u = (np.arange(count) + 0.5) / count
    # No bend tighter than a radius of 18 mm.
    most = length / 18.0 / 1.6
    if shape == "loop":
        share = 2.0 * np.pi * 19.0 / length
        angles = loop_profile(u, rng.uniform(0.45, 0.6), share, rng.choice([-1.0, 1.0]))
        angles += angle_profile(u, np.radians(rng.uniform(-15, 15)), 0.0)
    else:
        ranges = {"straight": (25.0, 12.0), "arc": (215.0, 20.0), "wave": (60.0, 55.0)}
        turn, wave = (np.radians(value) / np.sqrt(neighbours) for value in ranges[shape])
        angles = angle_profile(u, np.clip(rng.uniform(-turn, turn), -most, most), rng.uniform(-wave, wave))
    return length, angles - angles[0]


def _draw_gripper(
    index: int, scene: SceneParams, shapes: list[tuple[float, FloatArray]], speed: float, rng: np.random.Generator
) -> GripperPlan:
    params = scene.grippers[index]
    held = [(c, s) for c, s in zip(scene.cables, shapes, strict=True) if c.gripper == index]
    heading = rng.uniform(-np.pi, np.pi)
    chord = _chord(held, heading)
    strokes = _draw_strokes(params, heading, chord, scene.rest_before_s, speed, rng)
    # Aim: the middle of the cables and of the way lies near the middle of the view.
    ways = np.cumsum([[0.0, 0.0]] + [list(s.move_mm) for s in strokes], axis=0)
    middle = 0.5 * chord + 0.5 * (ways.min(axis=0) + ways.max(axis=0))
    start = -middle + rng.normal(0.0, [14.0, 9.0])
    return GripperPlan(
        start=(float(start[0]), float(start[1]), float(heading)),
        strokes=strokes,
        scale=params.scale * float(rng.uniform(0.88, 1.04)),
        bar_mm=params.bar_mm,
    )


def _chord(held: list[tuple[CableParams, tuple[float, FloatArray]]], heading: float) -> FloatArray:
    ends = []
    for cable, (length, angles) in held:
        ends.append(curve_from_angles(np.zeros(2), heading + np.radians(cable.fan_deg) + angles, length)[-1])
    return np.mean(ends, axis=0) if ends else np.zeros(2)


def _draw_strokes(
    params: GripperParams,
    heading: float,
    chord: FloatArray,
    rest_s: float,
    speed: float,
    rng: np.random.Generator,
) -> tuple[Stroke, ...]:
    strokes: list[Stroke] = []
    now_s = rest_s + rng.uniform(0.0, 0.015)
    side = rng.choice([-1.0, 1.0])
    for stroke in params.strokes:
        distance = stroke.distance_mm if stroke.distance_mm is not None else _draw_distance(speed, rng)
        if stroke.back and strokes:
            last = strokes[-1]
            move = (-last.move_mm[0], -last.move_mm[1])
            distance, turn = float(np.hypot(*move)), -last.turn_rad
        else:
            across = np.arctan2(chord[1], chord[0]) + side * np.pi / 2
            angle = {
                "across": across + rng.normal(0.0, 0.4),
                "along": heading + np.pi + rng.normal(0.0, 0.06),
                "any": rng.uniform(-np.pi, np.pi),
            }[stroke.direction]
            move = (float(distance * np.cos(angle)), float(distance * np.sin(angle)))
            turn = np.radians(stroke.turn_deg) if stroke.turn_deg is not None else float(rng.normal(0.0, 0.12))
        mean = stroke.mean_speed_mm_s if stroke.mean_speed_mm_s is not None else speed
        start_s = now_s + stroke.delay_s
        strokes.append(Stroke(start_s, distance / mean, move, float(turn), float(rng.uniform(0.0, 0.5))))
        now_s = start_s + distance / mean
    return tuple(strokes)


def _draw_distance(speed: float, rng: np.random.Generator) -> float:
    """Fast strokes are long, as on a robot that needs room to reach its speed."""
    return float(rng.uniform(55.0, 85.0) + 45.0 * min(speed / 1200.0, 1.0))


def _lay_out(
    scene: SceneParams, shapes: list[tuple[float, FloatArray]], grippers: list[GripperPlan], rng: np.random.Generator
) -> list[FloatArray]:
    """Plane curves (S + 1, 2) of all cables."""
    curves: list[FloatArray] = []
    for cable, (length, angles) in zip(scene.cables, shapes, strict=True):
        if cable.gripper >= 0:
            x, y, heading = grippers[cable.gripper].start
            start = np.array([x, y]) + cable.offset_mm * np.array([-np.sin(heading), np.cos(heading)])
            curves.append(curve_from_angles(start, heading + np.radians(cable.fan_deg) + angles, length))
        elif cable.loose:
            curves.append(_in_the_way(curves[0], grippers[0], length, rng))
        else:
            heading = rng.uniform(-np.pi, np.pi)
            free = curve_from_angles(np.zeros(2), heading + angles, length)
            curves.append(free - free.mean(axis=0) + rng.normal(0.0, [18.0, 12.0]))
    return curves


def _in_the_way(pusher: FloatArray, gripper: GripperPlan, length: float, rng: np.random.Generator) -> FloatArray:
    """Like a piece of the pusher, some way ahead of it, bent a little differently."""
    move = np.asarray(gripper.strokes[0].move_mm)
    ahead = move / np.hypot(*move) * rng.uniform(14.0, 26.0)
    steps = np.diff(pusher, axis=0)
    angles = np.unwrap(np.arctan2(steps[:, 1], steps[:, 0]))
    count = min(len(angles) - 4, max(8, round(length / SEGMENT_MM)))
    first = int(rng.integers(3, len(angles) - count)) if len(angles) - count > 3 else 3
    piece = angles[first : first + count]
    bent = piece[0] + (piece - piece[0]) * rng.uniform(0.4, 1.1) + rng.normal(0.0, 0.08)
    curve = curve_from_angles(np.zeros(2), bent, SEGMENT_MM * count)
    return np.asarray(curve - curve.mean(axis=0) + pusher[first : first + count + 1].mean(axis=0) + ahead)


def _score(scene: SceneParams, curves: list[FloatArray], grippers: list[GripperPlan]) -> float:
    """Not negative: everything is well in the view and apart. Otherwise the larger, the less is wrong."""
    score = 0.0
    for cable, curve in zip(scene.cables, curves, strict=True):
        places = [curve]
        if cable.gripper >= 0:
            for way in np.cumsum([s.move_mm for s in grippers[cable.gripper].strokes], axis=0):
                places.append(curve + way)
        for place in places:
            inside = np.asarray((np.abs(place) < np.asarray(HALF_VIEW_MM)).all(axis=1))
            wanted = 0.8 if cable.gripper >= 0 or cable.loose else 0.6
            score += min(0.0, float(inside.mean()) - wanted)
            if cable.gripper >= 0 and not inside[: len(inside) // 4].all():
                score -= 0.1
    diameters = [cable.diameter_mm or MECHANICS[cable.kind].diameter_mm for cable in scene.cables]
    for i, a in enumerate(curves):
        if scene.cables[i].shape != "loop" and _comes_near_itself(a, diameters[i]):
            score -= 1.0
        for j in range(i):
            both = {i, j}
            rest = all(scene.cables[k].gripper < 0 and not scene.cables[k].loose for k in both)
            if rest or scene.cables[i].support_mm != scene.cables[j].support_mm:
                continue
            gap = 0.5 * (diameters[i] + diameters[j])
            if float(distance_to_curve(a, curves[j]).min()) < gap + _GAP_MM * (0.1 if len(curves) > 2 else 1.0):
                score -= 1.0
    return score


def _comes_near_itself(curve: FloatArray, diameter_mm: float) -> bool:
    far = np.linalg.norm(curve[:, None] - curve[None], axis=2)
    apart = np.abs(np.subtract.outer(np.arange(len(curve)), np.arange(len(curve)))) * SEGMENT_MM > 30.0
    return bool((far[apart] < 2.0 * diameter_mm).any())


def _raise_over_crossings(scene: SceneParams, curves: list[FloatArray]) -> list[FloatArray]:
    """Chains (S + 1, 3): a cable climbs over those before it, and over itself; a held one starts high."""
    chains: list[FloatArray] = []
    for index, (cable, curve) in enumerate(zip(scene.cables, curves, strict=True)):
        diameter = cable.diameter_mm or MECHANICS[cable.kind].diameter_mm
        arc = np.linspace(0.0, 1.0, len(curve)) * np.linalg.norm(np.diff(curve, axis=0), axis=1).sum()
        z = np.full(len(curve), cable.support_mm + 0.5 * diameter)
        if cable.gripper >= 0:
            lift = 2.5 if diameter > 4.5 else 1.0
            z += lift * (1.0 - smooth_step(arc / (0.6 * arc[-1])))
        for i, j in crossings(curve, curve, skip=8):
            z = np.maximum(z, z.min() + bump(arc, arc[j], 1.04 * diameter, 26.0)) if i < j else z
        for below, other in zip(scene.cables[:index], chains, strict=True):
            if below.support_mm != cable.support_mm:
                continue
            half = 0.5 * (below.diameter_mm or MECHANICS[below.kind].diameter_mm)
            for i, j in crossings(curve, other[:, :2]):
                top = float(other[j, 2]) + half + 0.52 * diameter
                z = np.maximum(z, z.min() + bump(arc, arc[i], top - float(z.min()), 30.0))
        chains.append(np.concatenate([curve, z[:, None]], axis=1))
    return chains


def _cable_plan(index: int, scene: SceneParams, chain: FloatArray, board: str, rng: np.random.Generator) -> CablePlan:
    cable = scene.cables[index]
    usual = MECHANICS[cable.kind]
    diameter = cable.diameter_mm or usual.diameter_mm
    mass, bending = scaled_mechanics(cable.kind, diameter)
    number = {"tube": "dlo1", "printed": "dlo2", "cord": "dlo3", "wire": "dlo4"}[cable.kind]
    return CablePlan(
        name=number if len(scene.cables) == 1 else f"{number}_{index}",
        material=draw_material(cable.kind, cable.rgb, BOARD_RGB[board], rng),
        diameter_mm=diameter,
        kg_per_m=mass * float(rng.uniform(0.85, 1.15)),
        bending_n_m2=bending * float(rng.uniform(0.7, 1.4)),
        friction=usual.friction * float(rng.uniform(0.75, 1.3)),
        chain_mm=chain,
        gripper=cable.gripper,
        loose=cable.loose,
        support_mm=cable.support_mm,
    )


def _place_plate(
    scene: SceneParams, chain: FloatArray, grippers: list[GripperPlan], rng: np.random.Generator
) -> tuple[float, float, float, float, float] | None:
    """Over the first cable's middle, along the first stroke: it hides a part of the cable all the time."""
    if scene.plate is None:
        return None
    at = chain[int(len(chain) * rng.uniform(0.45, 0.58))]
    strokes = [stroke for gripper in grippers for stroke in gripper.strokes]
    move = strokes[0].move_mm if strokes else (0.0, 1.0)
    angle = float(np.arctan2(move[1], move[0]))
    x, y = at[0] + 0.5 * move[0], at[1] + 0.5 * move[1]
    return float(x), float(y), angle, 130.0, scene.plate.half_width_mm


def _belt_place(chain: FloatArray, grippers: list[GripperPlan], rng: np.random.Generator) -> float:
    """Where the belt's middle runs, mm: under the first cable, half-way on its way."""
    way = sum((stroke.move_mm[1] for gripper in grippers[:1] for stroke in gripper.strokes), 0.0)
    return float(np.clip(chain[:, 1].mean() + 0.5 * way, -45.0, 45.0) + rng.uniform(-10.0, 10.0))
