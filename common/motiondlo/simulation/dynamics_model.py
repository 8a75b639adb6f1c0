"""The cables as a MuJoCo model: chains of capsules with bending springs, on planes with friction.

Units of the model are cm, g and s, in which masses and lengths of cables are neither tiny nor large.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from motiondlo.simulation.plan import CablePlan, GripperPlan, Plan

FloatArray = npt.NDArray[np.float64]

CM_PER_MM = 0.1
GRAVITY_CM_S2 = 981.0
TIMESTEP_S = 0.00025
# Material damping: torque per bending rate over torque per bend. Keeps the stiff springs stable at this time step too.
DAMPING_S = 0.003
# The gripper's own inertia, so large that cables cannot move it.
GRIPPER_INERTIA = 1e7
_EI_CGS = 1e9  # N m^2 to g cm^3 / s^2


def model_xml(plan: Plan) -> str:
    """The model of all cables that can move. Joints of grippers come first, in order: x, y and turn each."""
    planes = sorted({cable.support_mm for cable in plan.cables if cable.dynamic})
    bodies = [
        f'<geom type="plane" size="0 0 1" pos="0 0 {CM_PER_MM * height}" contype="0" conaffinity="{1 << level}"/>'
        for level, height in enumerate(planes)
    ]
    exclusions: list[str] = []
    dynamic = [(index, cable) for index, cable in enumerate(plan.cables) if cable.dynamic]
    masks = {index: 1 << (8 + order) for order, (index, _) in enumerate(dynamic)}
    for number, gripper in enumerate(plan.grippers):
        held = [(index, cable) for index, cable in dynamic if cable.gripper == number]
        bodies.append(_gripper_xml(number, gripper, held, planes, masks, plan, exclusions))
    for index, cable in dynamic:
        if cable.gripper < 0:
            bodies.append(_chain_xml(index, cable, planes, masks, plan, exclusions, held_at=None))
    return (
        "<mujoco>"
        f'<option timestep="{TIMESTEP_S}" gravity="0 0 {-GRAVITY_CM_S2}" integrator="implicitfast" cone="pyramidal"'
        ' solver="Newton" iterations="12" ls_iterations="12"/>'
        '<compiler angle="radian" autolimits="true"/>'
        '<default><geom solref="0.004 1" solimp="0.9 0.98 0.01"/></default>'
        f"<worldbody>{''.join(bodies)}</worldbody>"
        f"<contact>{''.join(exclusions)}</contact>"
        "</mujoco>"
    )


def _gripper_xml(
    number: int,
    gripper: GripperPlan,
    held: list[tuple[int, CablePlan]],
    planes: list[float],
    masks: dict[int, int],
    plan: Plan,
    exclusions: list[str],
) -> str:
    x, y, heading = gripper.start
    joints = "".join(
        f'<joint name="g{number}{name}" type="{kind}" axis="{axis}" armature="{GRIPPER_INERTIA}"/>'
        for name, kind, axis in (("x", "slide", "1 0 0"), ("y", "slide", "0 1 0"), ("a", "hinge", "0 0 1"))
    )
    chains = "".join(
        _chain_xml(index, cable, planes, masks, plan, exclusions, held_at=(x, y, heading)) for index, cable in held
    )
    # The body stands in the world's directions at the start; x and y joints come before the turn.
    return (
        f'<body name="g{number}" pos="{CM_PER_MM * x} {CM_PER_MM * y} 0">{joints}'
        f'<inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/>{chains}</body>'
    )


def _chain_xml(
    index: int,
    cable: CablePlan,
    planes: list[float],
    masks: dict[int, int],
    plan: Plan,
    exclusions: list[str],
    held_at: tuple[float, float, float] | None,
) -> str:
    vertices = CM_PER_MM * cable.chain_mm
    steps = np.diff(vertices, axis=0)
    length = float(np.linalg.norm(steps, axis=1).mean())
    yaw = np.unwrap(np.arctan2(steps[:, 1], steps[:, 0]))
    pitch = np.arctan2(steps[:, 2], np.hypot(steps[:, 0], steps[:, 1]))
    frames = [_frame(a, b) for a, b in zip(yaw, pitch, strict=True)]
    stiffness = _EI_CGS * cable.bending_n_m2 / length
    mass = cable.kg_per_m * 10.0 * length
    radius = 0.5 * CM_PER_MM * cable.diameter_mm
    others = sum(
        mask for other, mask in masks.items() if other != index and plan.cables[other].support_mm == cable.support_mm
    )
    touches_itself = plan.scene.cables[index].shape == "loop"
    own = masks[index] if touches_itself else 0
    geom = (
        f'<geom type="capsule" fromto="0 0 0 {length} 0 0" size="{radius}" mass="{mass}"'
        f' friction="{cable.friction} 0 0"'
        f' contype="{(1 << planes.index(cable.support_mm)) | masks[index]}" conaffinity="{others | own}" condim="3"/>'
    )
    joint = "".join(
        f'<joint name="c{index}s{{number}}{name}" axis="{axis}" stiffness="{stiffness}"'
        f' damping="{DAMPING_S * stiffness}"/>'
        for name, axis in (("y", "0 0 1"), ("p", "0 1 0"))
    )
    text = ""
    for number in reversed(range(len(steps))):
        if number == 0:
            start = vertices[0] - (0.0 if held_at is None else CM_PER_MM * np.array([held_at[0], held_at[1], 0.0]))
            place, turn = start, frames[0]
            own_joint = "<freejoint/>" if held_at is None else ""
        else:
            place, turn = np.array([length, 0.0, 0.0]), frames[number - 1].T @ frames[number]
            own_joint = joint.format(number=number)
        text = (
            f'<body name="c{index}b{number}" pos="{_text(place)}" xyaxes="{_text(turn[:, 0])} {_text(turn[:, 1])}">'
            f"{own_joint}{geom}{text}</body>"
        )
    if touches_itself:
        near = int(np.ceil(3.0 * cable.diameter_mm * CM_PER_MM / length))
        exclusions += [
            f'<exclude body1="c{index}b{i}" body2="c{index}b{j}"/>'
            for i in range(len(steps))
            for j in range(i + 2, min(i + near + 1, len(steps)))
        ]
    return text


def _frame(yaw: float, pitch: float) -> FloatArray:
    """Columns: along the segment, left of it in the plane, up."""
    along = np.array([np.cos(yaw) * np.cos(pitch), np.sin(yaw) * np.cos(pitch), np.sin(pitch)])
    left = np.array([-np.sin(yaw), np.cos(yaw), 0.0])
    return np.stack([along, left, np.cross(along, left)], axis=1)


def _text(values: FloatArray) -> str:
    return " ".join(repr(float(value)) for value in values)
