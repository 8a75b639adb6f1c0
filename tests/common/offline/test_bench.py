from __future__ import annotations

import gc

import numpy as np
import pytest

from motiondlo.offline import bench
from motiondlo.offline.bench import Timing, measure, percentiles
from motiondlo.offline.frame_segmenter import FrameSegmenter
from motiondlo.offline.machine import machine_facts
from motiondlo.offline.options import TrackMode, TrackOptions
from motiondlo.recording.layout import open_recording

EVENT_MODE = TrackOptions(profile="paper", mode=TrackMode.EVENT, update_us=2000)


@pytest.mark.shared_data
def test_every_update_is_timed_stage_by_stage(excerpt):
    timing = measure(open_recording(excerpt(event_bytes=500_000)), EVENT_MODE)
    n = len(timing.total_ns)
    assert n > 20
    assert {len(ns) for ns in timing.stages_ns.values()} == {n}
    names = list(timing.stages_ns)
    assert (names[0], names[-1]) == ("decode", "fusion")
    assert {"time_surfaces", "publication"} <= set(names)
    assert len(timing.cpu_ns) == n
    staged = sum(timing.stages_ns.values())
    assert (staged <= timing.total_ns).all()
    # What no stage accounts for must stay small, or the table would hide where the time goes.
    assert staged.sum() > 0.9 * timing.total_ns.sum()
    assert gc.isenabled()
    assert gc.get_freeze_count() == 0


@pytest.mark.shared_data
def test_segmenting_frames_is_not_counted(excerpt, monkeypatch):
    now_ns = [0]

    def clock():
        now_ns[0] += 1000
        return now_ns[0]

    real_segment = FrameSegmenter.segment

    def slow_segment(self, entry):
        now_ns[0] += 10**9
        return real_segment(self, entry)

    monkeypatch.setattr(bench, "perf_counter_ns", clock)
    monkeypatch.setattr(FrameSegmenter, "segment", slow_segment)
    options = TrackOptions(mode=TrackMode.FRAME, segmenter_latency_ms=10.0, update_us=5000)
    timing = measure(open_recording(excerpt(event_bytes=300_000)), options)
    assert now_ns[0] > 3 * 10**9
    assert timing.total_ns.max() < 10_000


def test_document_of_a_profile():
    timing = Timing(
        total_ns=np.arange(1, 101, dtype=np.int64) * 10_000,
        cpu_ns=np.full(100, 4_000),
        moving=np.arange(100) >= 50,
        stages_ns={"decode": np.full(100, 5_000), "fusion": np.where(np.arange(100) >= 50, 2_000, 0)},
        events=50_500,
    )
    document = timing.as_json()
    assert document["updates"] == 100
    assert document["update_ms"] == {"p50": 0.505, "p99": 0.9901, "max": 1.0}
    assert document["update_moving_ms"]["p50"] == 0.755
    assert document["stages_ms"] == {"decode": {"p50": 0.005, "p99": 0.005}, "fusion": {"p50": 0.001, "p99": 0.002}}
    assert document["stages_moving_ms"]["fusion"] == {"p50": 0.002, "p99": 0.002}
    assert document["update_cpu_ms"] == {"p50": 0.004, "p99": 0.004, "max": 0.004}
    without = timing.total_ns - timing.stages_ns["decode"] - timing.stages_ns["fusion"]
    assert document["update_tracker_ms"]["max"] == pytest.approx(without.max() / 1e6)
    assert document["events_per_s"] == 1_000_000


def test_percentiles_of_nothing():
    assert percentiles(np.empty(0)) == {"p50": None, "p99": None, "max": None}


def test_machine_facts_name_the_processor_and_the_versions():
    facts = machine_facts()
    assert facts["cpu"]
    assert facts["cores"] >= 1
    assert {"numpy", "numba", "python", "motiondlo"} <= facts.keys()
