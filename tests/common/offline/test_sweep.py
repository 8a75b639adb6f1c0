from __future__ import annotations

import json

import numpy as np
import pytest

from motiondlo.cli.main import main
from motiondlo.events.evt3 import Evt3Decoder
from motiondlo.offline import sweep as module
from motiondlo.offline.bench import decoded_batches
from motiondlo.offline.nearest import places_on
from motiondlo.offline.sweep import Point, fit_load, measure_point
from motiondlo.offline.sweep_scene import DIAMETER_PX, SweepScene
from motiondlo.tracking.backlog import Backlog


def _events(scene):
    raw, count = scene.raw()
    batches = decoded_batches(Evt3Decoder(scene.geometry), [raw], 1000)
    events = np.concatenate([batch.events for batch in batches])
    assert len(events) == count
    return events


def test_scene_has_the_rate_it_is_asked_for_and_is_the_same_every_time():
    scene = SweepScene(2, 4e6, 40_000)
    assert len(_events(scene)) == pytest.approx(160_000, rel=0.01)
    assert scene.raw() == scene.raw()


def test_events_lie_on_the_silhouettes_and_the_leading_one_is_on():
    scene = SweepScene(1, 1e6, 60_000, noise_hz=0.0)
    events = _events(scene)
    at_us = 40_000
    near = events[np.abs(events["t"] - at_us) < 500]
    nodes = scene.nodes(0, at_us)
    xy = np.stack([near["x"], near["y"]], axis=1).astype(float)
    of_cable = (xy[:, 0] > nodes[5, 0]) & (xy[:, 0] < nodes[-5, 0])
    xy, on = xy[of_cable], near["p"][of_cable] == 1
    assert len(xy) > 100
    distance = places_on(nodes[None], xy[None]).distance[0]
    assert np.median(np.abs(distance - 0.5 * DIAMETER_PX)) < 1.0
    middle = np.interp(xy[:, 0], nodes[:, 0], nodes[:, 1])
    ahead = (xy[:, 1] - middle) * np.sign(scene.velocity_px_us(at_us, 0)[1]) > 0
    assert (ahead == on).mean() > 0.98


def test_truth_does_not_stretch():
    scene = SweepScene(3, 1e6, 1000)
    for cable in range(3):
        steps = [np.hypot(*np.diff(scene.nodes(cable, t), axis=0).T) for t in (0, 31_000, 77_000)]
        assert np.allclose(steps[0], steps[1])
        assert np.allclose(steps[0], steps[2])
        assert steps[0].max() / steps[0].min() < 1.02


class _Clock:
    """Processor time that only the tracker's updates take."""

    def __init__(self):
        self.ns = 0

    def __call__(self):
        return self.ns


def _slow(monkeypatch, update_us):
    clock = _Clock()
    monkeypatch.setattr(module, "thread_time_ns", clock)
    real = module.make_tracker

    def make(*args, **kwargs):
        tracker = real(*args, **kwargs)
        update = tracker.update

        def slow(batch):
            clock.ns += update_us * 1000
            return update(batch)

        tracker.update = slow
        return tracker

    monkeypatch.setattr(module, "make_tracker", make)


def test_a_core_that_keeps_up_has_the_latency_of_an_update(monkeypatch):
    _slow(monkeypatch, update_us=800)
    point = measure_point(SweepScene(1, 5e5, 60_000), "default", 2000)
    assert len(point.update_ns) == 30
    assert point.latency_us == pytest.approx([800.0] * 30)
    assert (point.backlog_most, point.dropped_batches) == (1, 0)
    assert point.load == pytest.approx(0.4)
    assert np.mean(point.error_px) < 2.0


def test_above_capacity_the_backlog_is_bounded_and_the_newest_is_kept(monkeypatch):
    _slow(monkeypatch, update_us=4000)
    backlog = Backlog(patience=1, most=2, most_waiting=5)
    point = measure_point(SweepScene(1, 5e5, 120_000), "default", 2000, backlog)
    assert point.dropped_batches > 10
    assert point.dropped_batches + len(point.update_ns) == 60
    assert point.backlog_most == 5
    assert point.dropped_events / point.events == pytest.approx(point.dropped_batches / 60, abs=0.05)
    # Five batches wait at most, behind a publication of two, and each takes 4 ms.
    assert max(point.latency_us) <= 7 * 4000
    document = point.as_json()
    assert document["backlog_batches"]["most"] == 5
    json.dumps(document, allow_nan=False)


def test_fit_of_a_linear_load_leaves_out_scenes_with_drops():
    points = []
    for dlos in (1, 2, 4):
        for mev in (1, 10):
            load = 0.05 + 0.02 * mev + 0.3 * dlos
            points.append(Point(dlos, mev * 1e6, 1.0, mev * 10**6, stages_ns={"all": round(load * 1e9)}))
    points.append(Point(8, 30e6, 1.0, 30 * 10**6, stages_ns={"all": 10**9}, dropped_batches=3))
    fit = fit_load(points)
    assert (fit.fixed, fit.per_mev, fit.per_dlo, fit.r2) == pytest.approx((0.05, 0.02, 0.3, 1.0))
    assert fit.points == 6
    assert fit_load(points[-1:]) is None


def test_command_prints_and_writes_the_sweep(tmp_path, capsys, monkeypatch):
    point = Point(
        2, 1e6, 0.1, 10**5, decode_surface_hz=5e7, update_ns=[10**6] * 50, latency_us=[1100.0] * 50,
        stages_ns={"decode": 10**6, "tracks": 5 * 10**7, "publication": 10**6, "fusion": 10**6}, error_px=[0.5],
    )  # fmt: skip
    monkeypatch.setattr(module, "sweep", lambda profile, period_us, progress: [point] * 5)
    assert main(["bench", "--sweep", "--json", str(tmp_path / "s.json")]) == 0
    out = capsys.readouterr().out
    assert "at least 50 Mev/s" in out
    assert "load =" in out
    entry = json.loads((tmp_path / "s.json").read_text())["profiles"]["default"]["points"][0]
    assert entry["update_ms"]["p50"] == 1.0
    assert entry["latency_ms"]["max"] == 1.1


def test_bench_wants_a_recording_or_the_sweep(capsys):
    assert main(["bench"]) == 1
    assert "--sweep" in capsys.readouterr().err
