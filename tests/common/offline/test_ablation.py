from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from motiondlo.errors import ConfigError
from motiondlo.offline import ablation
from motiondlo.offline.ablation import FULL, Figures, Trials, ablate, figures_of
from motiondlo.offline.ablation_table import DEFAULT_COMPONENTS, PAPER_COMPONENTS, Component, FrameCut, components_of
from motiondlo.offline.evaluation import evaluate
from motiondlo.offline.hybrid_loop import FrameBranch
from motiondlo.offline.options import TrackMode, TrackOptions
from motiondlo.recording.layout import FrameEntry, open_recording
from motiondlo.tracking.factory import PROFILES, tracker_params
from motiondlo.tracking.paper.params import PaperParams

# design of the product, "Algorithms": every component of the paper is a switch
PAPER_SWITCHES = {
    "noise_filter", "polarity_separated", "adaptive_decay", "diameter_scaled_morphology", "pca_centreline",
    "skeleton_path", "arc_length_parametrisation", "geodesic_kernel", "two_anchor_estep", "chain_laplacian",
    "velocity_warm_start", "sigma2_management", "two_pass", "soft_weights", "node_visibility", "correspondence_prior",
    "endpoint_extension", "reinit_on_drift", "reinit_on_stuck_span", "reinit_on_stagnation", "hibernation",
}  # fmt: skip


@pytest.mark.parametrize("profile", PROFILES)
def test_every_row_changes_the_profile_and_is_accepted_by_it(profile):
    whole = tracker_params(profile, {})
    rows = components_of(profile)
    assert len({row.name for row in rows}) == len(rows)
    for row in rows:
        without = tracker_params(profile, row.tracker)
        assert row.frames is not FrameCut.NOTHING or without != whole, row.name
        for name, value in row.tracker.items():
            assert getattr(without, name) == value != getattr(whole, name), f"{row.name}: {name}"


def test_the_papers_rows_are_all_of_its_switches():
    taken_out = [name for row in PAPER_COMPONENTS for name in row.tracker]
    switches = {name for name, field in PaperParams.model_fields.items() if field.annotation is bool}
    assert len(taken_out) == len(set(taken_out))
    assert set(taken_out) == switches
    assert switches >= PAPER_SWITCHES


def test_late_shapes_and_the_look_of_frames_can_be_taken_out():
    assert {row.frames for row in DEFAULT_COMPONENTS} == set(FrameCut)


def _figures(ptc_mm, e_mm, lost=0.0, switches=0, unchanged=False):
    return Figures(ptc_mm, e_mm, lost, switches, 1.0, unchanged)


def test_rows_are_sorted_by_what_they_earn_and_averaged_over_recordings(monkeypatch):
    parts = (Component("harm", ""), Component("idle", ""), Component("worth", ""))
    runs = {
        "a": [
            _figures(0.1, 0.2),
            _figures(0.05, 0.2),
            _figures(0.1, 0.2, unchanged=True),
            _figures(None, None, lost=1.0, switches=2),
            _figures(1.0, 2.0, lost=0.1),
        ],
        "b": [
            _figures(0.3, 0.4),
            _figures(0.3, 0.35),
            _figures(0.3, 0.4, unchanged=True),
            _figures(0.5, 0.4, switches=1),
            _figures(0.2, 0.1),
        ],
    }
    asked = []
    monkeypatch.setattr(ablation, "_recording_runs", lambda path, **_: iter(runs[path]))

    class Named:
        def __init__(self, name):
            self.name = self.path = name

    result = ablate([Named("a"), Named("b")], TrackOptions(), progress=asked.append, components=parts)
    assert [row.component.name for row in result.rows] == ["worth", "idle", "harm"]
    worth, idle, harm = result.rows
    # Lost all the time counts as 5 mm in each error and 5 mm for the time.
    assert worth.earns_mm == pytest.approx((15.0 - 0.3 + 0.2) / 2)
    assert harm.earns_mm == pytest.approx(-0.05)
    assert (idle.earns_mm, idle.mean.unchanged) == (0.0, True)
    assert (worth.mean.ptc_mm, worth.mean.lost_fraction, worth.mean.id_switches) == (0.5, 0.5, 3)
    assert result.full.mean.ptc_mm == pytest.approx(0.2)
    assert result.other is not None
    assert result.other.component.name == "paper"
    assert asked[-1] == 1.0
    assert asked == sorted(asked)
    document = result.as_json()
    assert [row["component"] for row in document["without"]] == ["worth", "idle", "harm"]
    assert document["without"][0]["recordings"][0]["ptc_mm"] is None


def test_figures_are_of_the_dlos_that_move(make_truth, as_tracks):
    truth = make_truth(speeds_px_ms=(1.0, 0.0, 1.0))
    tracks = as_tracks(truth)
    nodes = tracks.nodes.copy()
    nodes[tracks.ids == 1] += np.float32(500.0)
    nodes[tracks.ids == 2, :, 1] += np.float32(2.0)
    figures = figures_of(evaluate(replace(tracks, nodes=nodes), truth))
    assert figures.ptc_mm == pytest.approx(0.2, abs=1e-3)
    assert figures.lost_fraction == 0.0


def test_frame_mode_has_nothing_to_take_apart():
    with pytest.raises(ConfigError, match="frame mode"):
        ablate([], TrackOptions(mode=TrackMode.FRAME))


@pytest.mark.shared_data
def test_frames_are_segmented_once_and_a_component_changes_the_estimates(excerpt, shared_data, monkeypatch):
    folder = excerpt(event_bytes=400_000)
    (folder / "ground_truth.npz").symlink_to(shared_data / "single_dlo3_speed50" / "ground_truth.npz")
    trials = Trials(open_recording(folder))
    segmented = []
    real = Trials._remembered

    def watched(self, segment, entry):
        return real(self, lambda e: segmented.append(e.name) or segment(e), entry)

    monkeypatch.setattr(Trials, "_remembered", watched)
    whole, _ = trials.run(TrackOptions())
    again, _ = trials.run(TrackOptions(), FULL)
    rows = {row.name: row for row in DEFAULT_COMPONENTS}
    bare, _ = trials.run(TrackOptions(), rows["frame's edge profile"])
    assert len(segmented) == len(set(segmented)) > 0
    assert np.array_equal(whole.nodes, again.nodes)
    assert not np.array_equal(whole.nodes, bare.nodes)


def test_without_late_corrections_only_the_first_frame_is_left():
    frames = tuple(FrameEntry(f"f{k}", None, 50_000 * k) for k in range(3))
    branch = FrameBranch(frames, segment=lambda entry: entry.name, latency_us=0)
    trials = object.__new__(Trials)
    trials._shapes = {}
    cut = trials._cut(FrameCut.LATE, branch)
    assert cut.frames == frames[:1]
    assert cut.segment(frames[0]) == "f0"
    assert trials._cut(FrameCut.NOTHING, branch).frames == frames
