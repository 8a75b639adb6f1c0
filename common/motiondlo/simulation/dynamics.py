"""Move the cables: the grippers' ways are given, everything else follows from elasticity, friction and contact."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from motiondlo.errors import MotionDLOError
from motiondlo.simulation.dynamics_model import CM_PER_MM, GRIPPER_INERTIA, TIMESTEP_S, model_xml
from motiondlo.simulation.plan import Plan
from motiondlo.simulation.strokes import gripper_poses

FloatArray = npt.NDArray[np.float64]

SAMPLE_S = 0.0005
SETTLE_S = 0.3


@dataclass(frozen=True)
class Motion:
    """Where everything is, sampled every SAMPLE_S from time 0."""

    chains_mm: tuple[FloatArray, ...]
    """Per cable (T, S + 1, 3): vertices of its chain, mm."""
    grippers: tuple[FloatArray, ...]
    """Per gripper (T, 3): x, y in mm and direction in rad."""

    def chain(self, cable: int, time_s: float) -> FloatArray:
        """(S + 1, 3) vertices at a time, interpolated."""
        return _at(self.chains_mm[cable], time_s)

    def gripper(self, number: int, time_s: float) -> FloatArray:
        """(3,) pose at a time, interpolated."""
        return _at(self.grippers[number], time_s)


def _at(samples: FloatArray, time_s: float) -> FloatArray:
    place = min(max(time_s / SAMPLE_S, 0.0), len(samples) - 1.0)
    index = min(int(place), len(samples) - 2)
    u = place - index
    return np.asarray((1.0 - u) * samples[index] + u * samples[index + 1])


def simulate_motion(plan: Plan, progress: Callable[[float], None] = lambda share: None) -> Motion:
    """Run the physics. Raises MotionDLOError when MuJoCo is not installed or the motion is unstable."""
    try:
        import mujoco
    except ImportError as error:
        raise MotionDLOError(
            "MuJoCo is not installed.", "Install the extra: pip install 'motiondlo[simulate]'."
        ) from error
    count = round((plan.duration_s + 0.01) / SAMPLE_S) + 1
    per_sample = round(SAMPLE_S / TIMESTEP_S)
    settle = round(SETTLE_S / TIMESTEP_S)
    times_s = TIMESTEP_S * np.arange(-settle, (count - 1) * per_sample + 1, dtype=np.float64)
    poses = [gripper_poses(gripper.start, gripper.strokes, times_s) for gripper in plan.grippers]
    dynamic = [index for index, cable in enumerate(plan.cables) if cable.dynamic]
    chains = [
        np.zeros((count, *cable.chain_mm.shape)) if cable.dynamic else np.tile(cable.chain_mm, (count, 1, 1))
        for cable in plan.cables
    ]
    if dynamic:
        model = mujoco.MjModel.from_xml_string(model_xml(plan))
        data = mujoco.MjData(model)
        bodies = {
            index: [model.body(f"c{index}b{s}").id for s in range(len(plan.cables[index].chain_mm) - 1)]
            for index in dynamic
        }
        relative = [(pose - pose[0]) * [CM_PER_MM, CM_PER_MM, 1.0] for pose in poses]
        driver = _Driver(model, relative)
        for step in range(len(times_s)):
            driver.place(data, step)
            if step >= settle and (step - settle) % per_sample == 0:
                mujoco.mj_kinematics(model, data)
                sample = (step - settle) // per_sample
                for index, ids in bodies.items():
                    chains[index][sample] = _vertices(data, ids) / CM_PER_MM
                if sample % 100 == 0:
                    progress(sample / count)
            driver.push(data, step)
            mujoco.mj_step(model, data)
            if step < settle:
                data.qvel *= 0.995
        if not all(np.isfinite(chains[index]).all() for index in dynamic) or data.warning.number.any():
            raise MotionDLOError(f"{plan.name}: the motion is unstable.", "Try another seed, or a slower stroke.")
    samples = slice(settle, None, per_sample)
    return Motion(tuple(chains), tuple(pose[samples] for pose in poses))


class _Driver:
    """Holds the grippers exactly on their ways, with the forces that their acceleration needs."""

    def __init__(self, model, relative: list[FloatArray]) -> None:  # type: ignore[no-untyped-def]
        self._address = [[model.joint(f"g{g}{axis}").qposadr[0] for axis in "xya"] for g in range(len(relative))]
        self._speed_address = [[model.joint(f"g{g}{axis}").dofadr[0] for axis in "xya"] for g in range(len(relative))]
        self._poses = relative
        self._speeds = [np.gradient(pose, TIMESTEP_S, axis=0) for pose in relative]
        self._accelerations = [np.gradient(speed, TIMESTEP_S, axis=0) for speed in self._speeds]

    def place(self, data, step: int) -> None:  # type: ignore[no-untyped-def]
        for g, pose in enumerate(self._poses):
            data.qpos[self._address[g]] = pose[step]
            data.qvel[self._speed_address[g]] = self._speeds[g][step]

    def push(self, data, step: int) -> None:  # type: ignore[no-untyped-def]
        for g, acceleration in enumerate(self._accelerations):
            data.qfrc_applied[self._speed_address[g]] = GRIPPER_INERTIA * acceleration[step]


def _vertices(data, ids: list[int]) -> FloatArray:  # type: ignore[no-untyped-def]
    starts = data.xpos[ids]
    last = ids[-1]
    along = data.xmat[last].reshape(3, 3)[:, 0]
    length = float(np.linalg.norm(starts[-1] - starts[-2]))
    return np.concatenate([starts, (starts[-1] + length * along)[None]])
