"""CORRECTION_IN_MOTION: shapes of frames that were taken while DLOs move, and that come while they still do."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import lru_cache
from pathlib import Path

import pytest

from motiondlo.offline.evaluation import Verdict, evaluate
from motiondlo.offline.ground_truth import load_ground_truth
from motiondlo.offline.hybrid_loop import FrameBranch
from motiondlo.offline.options import TrackOptions
from motiondlo.offline.run_track import prepare, rows_of
from motiondlo.offline.wrong_segmentation import WrongShape, with_wrong_shapes
from motiondlo.recording.layout import open_recording

pytestmark = pytest.mark.shared_data

LATENCY_MS = 150.0
"""Short, so that several come within a stroke."""
LEAST_MM = 0.03
"""Below this an error in pairs has no meaning: it is a sixth of a pixel."""


@pytest.fixture(scope="module")
def tracked(shared_data: Path) -> Callable[..., Verdict]:
    @lru_cache
    def track(name: str, shapes: str) -> Verdict:
        """shapes: "none" as in a cell, where none is asked for in motion; "right"; or a kind of wrong ones."""
        folder = shared_data / name
        truth = load_ground_truth(folder / "ground_truth.npz")

        def changed(branch: FrameBranch) -> FrameBranch:
            if shapes == "none":
                return branch
            if shapes != "right":
                branch = with_wrong_shapes(WrongShape(shapes), truth.px_per_mm)(branch)
            return replace(branch, ask_always=True)

        run = prepare(open_recording(folder), TrackOptions(segmenter_latency_ms=LATENCY_MS), changed)
        return evaluate(rows_of(run.states()), truth).moved[0]

    return track


def assert_no_worse(with_shapes: Verdict, without: Verdict) -> None:
    for mine, others in ((with_shapes.ptc_mm, without.ptc_mm), (with_shapes.e_mm, without.e_mm)):
        assert mine.mean is not None
        assert others.mean is not None
        assert mine.mean <= 1.1 * others.mean + LEAST_MM
    assert with_shapes.lost_fraction <= without.lost_fraction
    assert with_shapes.id_switches == 0


@pytest.mark.parametrize("name", ["loop", "occlusion", "two_moving"])
def test_right_shapes_do_no_harm(tracked: Callable[..., Verdict], name: str) -> None:
    assert_no_worse(tracked(name, "right"), tracked(name, "none"))


@pytest.mark.parametrize(
    ("name", "kind"),
    [
        ("conveyor", WrongShape.SHIFTED),  # the belt's events leave little confidence in a DLO at rest
        ("conveyor", WrongShape.SWAPPED),
        ("loop", WrongShape.MIRRORED),
        ("loop", WrongShape.MERGED),
        ("loop", WrongShape.SHORTENED),
        ("loop", WrongShape.EXTRA),
    ],
)
def test_wrong_shapes_do_no_harm(tracked: Callable[..., Verdict], name: str, kind: WrongShape) -> None:
    assert_no_worse(tracked(name, kind.value), tracked(name, "none"))
