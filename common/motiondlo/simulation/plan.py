"""A scene with every open choice made: what the simulation is given."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from motiondlo.simulation.materials import Material
from motiondlo.simulation.scene import SceneParams
from motiondlo.simulation.strokes import Stroke

FloatArray = npt.NDArray[np.float64]


@dataclass(frozen=True)
class CablePlan:
    """One cable at rest."""

    name: str
    material: Material
    diameter_mm: float
    kg_per_m: float
    bending_n_m2: float
    friction: float
    chain_mm: FloatArray
    """(S + 1, 3) vertices of a chain of equal segments; vertex 0 is held."""
    gripper: int
    loose: bool
    support_mm: float

    @property
    def length_mm(self) -> float:
        """Along the chain."""
        return float(np.linalg.norm(np.diff(self.chain_mm, axis=0), axis=1).sum())

    @property
    def dynamic(self) -> bool:
        """Whether it can move at all."""
        return self.loose or self.gripper >= 0


@dataclass(frozen=True)
class GripperPlan:
    """One gripper: its pose at the start and what it does."""

    start: tuple[float, float, float]
    """x, y in mm and the direction in which the cables leave it, rad."""
    strokes: tuple[Stroke, ...]
    scale: float
    bar_mm: float


@dataclass(frozen=True)
class Plan:
    """Everything that the simulation of a recording needs but the seed of its noise."""

    name: str
    seed: int
    scene: SceneParams
    board: str
    duration_s: float
    cables: tuple[CablePlan, ...]
    grippers: tuple[GripperPlan, ...]
    plate: tuple[float, float, float, float, float] | None = None
    """Centre x, y in mm, angle, half length, half width."""
    belt_y_mm: float = 0.0
    flicker_spot_mm: tuple[float, float] = field(default=(0.0, 0.0))
