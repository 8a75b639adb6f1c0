"""The homography's correction in the running cell: learned from DLOs that moved, and taken back."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from motiondlo.fusion.alignment import FrameAlignment
from motiondlo.fusion.core import FusionCore
from motiondlo.fusion.params import FusionParams
from motiondlo.geometry.curve import distance_to_curve
from motiondlo.geometry.homography import warp_points
from motiondlo.tracking.types import TrackSource, TrackState

FloatArray = npt.NDArray[np.float64]

OFF = np.array([[1.002, 0.001, 0.8], [-0.001, 1.001, -1.1], [0.0, 0.0, 1.0]])
"""How the given homography is wrong: true event px to where it puts them."""


def track(nodes: FloatArray, moving: bool = False, dlo_id: int = 0) -> TrackState:
    count = len(nodes)
    return TrackState(
        id=dlo_id,
        nodes=nodes,
        velocity_px_s=np.zeros((count, 2)),
        cov_px2=np.tile([0.1, 0.0, 0.1], (count, 1)),
        visible=np.ones(count, np.uint8),
        diameter_px=20.0,
        confidence=0.9,
        moving=moving,
        source=TrackSource.EVENT,
        t_corrected_us=-1,
    )


def pose(rng: np.random.Generator) -> FloatArray:
    """A bent cable somewhere in the image, (80, 2)."""
    u = np.linspace(-1.0, 1.0, 80)
    turn = rng.uniform(0.0, np.pi)
    along, across = 260.0 * u, rng.uniform(40.0, 120.0) * np.cos(2.0 * u)
    x = np.cos(turn) * along - np.sin(turn) * across
    y = np.sin(turn) * along + np.cos(turn) * across
    return np.stack([x + rng.uniform(400.0, 880.0), y + rng.uniform(300.0, 420.0)], axis=1)


def rests(alignment: FrameAlignment, count: int, off: FloatArray, rng: np.random.Generator, moves: bool = True) -> None:
    """One of four cables moves and comes to rest, ``count`` times; each time a frame is taken."""
    for k in range(count):
        nodes = pose(rng)
        if moves:
            alignment.saw((track(nodes, True, k % 4),))
        alignment.saw((track(nodes, False, k % 4),))
        seen = warp_points(nodes, off) + rng.normal(0.0, 0.1, nodes.shape)
        alignment.learn(seen, np.full(len(nodes), 0.2), track(nodes, False, k % 4))


def mean_error(alignment: FrameAlignment, off: FloatArray) -> float:
    rng = np.random.default_rng(99)
    gaps = [distance_to_curve(alignment.aligned(warp_points(n, off)), n).mean() for n in (pose(rng) for _ in range(10))]
    return float(np.mean(gaps))


def test_an_error_of_the_homography_is_learned_from_cables_that_moved() -> None:
    alignment = FrameAlignment()
    before = mean_error(alignment, OFF)
    rests(alignment, 20, OFF, np.random.default_rng(0))
    assert alignment.active
    assert mean_error(alignment, OFF) < 0.6 * before


def test_nothing_is_learned_from_cables_that_stand_where_a_frame_put_them() -> None:
    alignment = FrameAlignment()
    rests(alignment, 20, OFF, np.random.default_rng(0), moves=False)
    assert not alignment.active


def test_an_exact_homography_is_left_alone() -> None:
    alignment = FrameAlignment()
    rests(alignment, 20, np.eye(3), np.random.default_rng(1))
    assert mean_error(alignment, np.eye(3)) < 0.1


def test_a_correction_that_no_longer_helps_is_taken_back() -> None:
    alignment = FrameAlignment()
    rng = np.random.default_rng(0)
    rests(alignment, 12, OFF, rng)
    assert alignment.active
    # Somebody has calibrated, or moved a camera: the given homography is right now.
    rests(alignment, 30, np.eye(3), rng)
    assert alignment.reverted >= 1
    assert mean_error(alignment, np.eye(3)) < 0.3


def test_it_is_off_unless_asked_for() -> None:
    assert FusionCore(FusionParams()).alignment is None
    assert FusionCore(FusionParams(refine_homography=True)).alignment is not None
