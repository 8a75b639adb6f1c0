"""The segmenter's core: counts, back-off, and that no frame kills it."""

from __future__ import annotations

import numpy as np
import pytest

from motiondlo.frames.classical import ClassicalBackend
from motiondlo.frames.masks import MaskSet
from motiondlo.frames.params import FrameParams
from motiondlo_services.segmenter.core import BackoffPolicy, SegmenterCore

FRAME = np.full((240, 320, 3), 120, np.uint8)
POLICY = BackoffPolicy(first_us=100_000, longest_us=400_000, degraded_after=3)


class Backend:
    """Raises for as long as it is told to; finds nothing otherwise."""

    name = "scripted"

    def __init__(self, broken=False):
        self.broken = broken
        self.calls = 0

    def segment(self, image_bgr, background, frame_name):
        self.calls += 1
        if self.broken:
            raise RuntimeError("out of memory")
        return MaskSet()


def core_with(backend):
    return SegmenterCore(FrameParams(), backend, policy=POLICY)


def test_backend_that_raises_is_left_alone_for_twice_as_long_each_time():
    backend = Backend(broken=True)
    core = core_with(backend)
    assert core.on_frame(FRAME, 0, "a").failure == "backend_failed"
    assert core.retry_us == 100_000
    assert "out of memory" in core.problem
    assert core.on_frame(FRAME, 50_000, "b").failure == "backend_failed"
    assert backend.calls == 1
    core.on_frame(FRAME, 100_000, "c")
    assert (backend.calls, core.retry_us) == (2, 300_000)
    for t_us in (300_000, 700_000, 1_100_000):
        core.on_frame(FRAME, t_us, "d")
    assert core.retry_us == 1_500_000
    assert core.counts["paused"] == 1
    assert core.degraded


def test_backend_that_recovers_is_trusted_at_once():
    backend = Backend(broken=True)
    core = core_with(backend)
    core.on_frame(FRAME, 0, "a")
    backend.broken = False
    assert core.on_frame(FRAME, 100_000, "b").failure == "nothing_found"
    assert core.retry_us == -1
    assert core.problem == ""


def test_ordinary_failures_cause_no_pause_but_degrade():
    backend = Backend()
    core = core_with(backend)
    for k in range(3):
        assert not core.degraded
        assert core.on_frame(FRAME, k * 1000, "a").failure == "nothing_found"
    assert core.degraded
    assert backend.calls == 3
    assert core.counts["failure nothing_found"] == 3
    assert core.rejects.as_dict() == {"segmentation_failed": 3}


@pytest.mark.parametrize("bad", [np.zeros((240, 320), np.uint8), np.zeros((4, 4, 3), np.uint8)])
def test_frames_of_a_wrong_shape_are_counted_as_such(bad):
    core = core_with(Backend())
    assert core.on_frame(bad, 0, "a").failure == "wrong_size"
    assert core.rejects.as_dict() == {"frame_wrong_size": 1}


def test_instances_and_stage_times_are_counted():
    params = FrameParams()
    frame = np.full((486, 648, 3), 220, np.uint8)
    frame[230:246, 100:500] = (20, 20, 160)
    core = SegmenterCore(params, ClassicalBackend(params.foreground))
    result = core.on_frame(frame, 5, "x")
    assert (result.failure, len(result.instances), result.t_us) == ("", 1, 5)
    assert core.counts["instances"] == 1
    assert core.stages_ns["refine"] > 0
    assert not core.degraded
