"""SEGMENTER_WRONG, CORRECTION_LATE: wrong or late shapes through the real fusion and the real tracker."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from itertools import pairwise, takewhile
from pathlib import Path

import numpy as np
import pytest

from motiondlo.fusion.state import FusedState
from motiondlo.offline.evaluation import Verdict, evaluate
from motiondlo.offline.ground_truth import GroundTruth, load_ground_truth
from motiondlo.offline.nearest import places_on
from motiondlo.offline.options import TrackOptions
from motiondlo.offline.run_track import prepare, rows_of
from motiondlo.offline.wrong_segmentation import WrongShape, with_wrong_shapes
from motiondlo.recording.layout import open_recording

pytestmark = pytest.mark.shared_data

END_US = 3_300_000
"""Two strokes, two rests, and the corrections of both."""


@dataclass(frozen=True)
class Outcome:
    """One run."""

    verdict: Verdict
    refused: dict[str, int]
    around_corrections_mm: list[tuple[float, float]]
    """Error of the states right before and right after each correction."""


def error_mm(state: FusedState, truth: GroundTruth) -> float:
    t_us = np.array([state.t_us])
    places = places_on(truth.nodes_at(0, t_us), state.dlos[0].nodes[None].astype(np.float64))
    seen = truth.visibility[0, truth.nearest_index(t_us)[0]] == 0
    return float(places.distance[0][seen[places.nearest_node[0]]].mean() / truth.px_per_mm)


@pytest.fixture(scope="module")
def outcome(shared_data: Path) -> Callable[..., Outcome]:
    folder = shared_data / "stop_and_go"
    truth = load_ground_truth(folder / "ground_truth.npz")

    @lru_cache
    def track(kind: WrongShape | None, method: str = "bayes") -> Outcome:
        changed = None if kind is None else with_wrong_shapes(kind, truth.px_per_mm)
        run = prepare(open_recording(folder), TrackOptions(fusion={"method": method}), changed)
        states = list(takewhile(lambda state: state.t_us <= END_US, run.states()))
        (verdict,) = evaluate(rows_of(iter(states)), truth).moved
        around = [
            (error_mm(before, truth), error_mm(after, truth))
            for before, after in pairwise(states)
            if before.dlos and after.dlos[0].t_corrected_us != before.dlos[0].t_corrected_us
        ]
        return Outcome(verdict, run.loop.refused_shapes, around)

    return track


def test_a_correction_a_second_late_makes_nothing_worse(outcome: Callable[..., Outcome]) -> None:
    right = outcome(None)
    assert len(right.around_corrections_mm) >= 2
    for before, after in right.around_corrections_mm:
        assert after <= before + 0.01
    assert right.verdict.id_switches == 0
    assert right.refused == {}


@pytest.mark.parametrize("kind", list(WrongShape))
def test_wrong_shapes_are_outvoted(outcome: Callable[..., Outcome], kind: WrongShape) -> None:
    right, wrong = outcome(None).verdict, outcome(kind).verdict
    assert right.ptc_mm.mean is not None
    assert wrong.ptc_mm.mean is not None
    assert wrong.ptc_mm.mean <= 1.1 * right.ptc_mm.mean
    assert right.e_mm.mean is not None
    assert wrong.e_mm.mean is not None
    assert wrong.e_mm.mean <= 1.1 * right.e_mm.mean
    assert wrong.id_switches == 0
    assert wrong.lost_fraction == right.lost_fraction, "the end that is cut off, and nothing else"


@pytest.mark.parametrize(
    ("kind", "reason"),
    [
        (WrongShape.MIRRORED, "unconfirmed"),
        (WrongShape.SHIFTED, "outvoted"),
        (WrongShape.SWAPPED, "unconfirmed"),
        (WrongShape.EXTRA, "unconfirmed"),
    ],
)
def test_refused_shapes_are_counted_with_a_reason(
    outcome: Callable[..., Outcome], kind: WrongShape, reason: str
) -> None:
    refused = outcome(kind).refused
    assert set(refused) == {reason}
    assert refused[reason] >= 2
