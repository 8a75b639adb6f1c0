from __future__ import annotations

import re
from base64 import b64decode

import cv2
import numpy as np
import pytest

from motiondlo.events.reader import read_all
from motiondlo.offline.evaluation import evaluate
from motiondlo.offline.evaluation_page import evaluation_page
from motiondlo.offline.ground_truth import load_ground_truth
from motiondlo.offline.moment import picture_at, worst_moment
from motiondlo.offline.tracks import make_tracks


def _pictures(page):
    data = [b64decode(text) for text in re.findall(r"data:image/png;base64,([^\"]+)\"", page)]
    return [cv2.imdecode(np.frombuffer(png, np.uint8), cv2.IMREAD_COLOR) for png in data]


def test_page_shows_every_dlo_and_embeds_its_pictures(tmp_path, make_truth, as_tracks):
    truth = make_truth(speeds_px_ms=(2.0, 0.0))
    tracks = as_tracks(truth, offset_px=(0.0, 3.0))
    page = evaluation_page(tmp_path / "a <b>", tracks, truth, evaluate(tracks, truth))
    assert "<h1>a &lt;b&gt;</h1>" in page
    assert "<td>dlo0</td>" in page
    assert '<tr class="static"><td>dlo1</td>' in page
    assert not re.search(r"(src|href)=\"(?!data:)", page)
    plot, moment = _pictures(page)
    assert plot.shape[1] > 1000
    assert moment.shape == (720, 1280, 3)


def test_page_of_a_dlo_that_was_never_found(tmp_path, make_truth):
    truth = make_truth()
    nothing = make_tracks(np.empty(0, np.int64), np.empty((0, 2, 2), np.float32))
    page = evaluation_page(tmp_path, nothing, truth, evaluate(nothing, truth))
    assert "<td>none</td>" in page
    assert "100.0 %" in page
    assert len(_pictures(page)) == 1


def test_worst_moment_is_the_judged_estimate_that_is_farthest_off(make_truth, as_tracks):
    truth = make_truth()
    truth.moving[0, 150:] = False
    tracks = as_tracks(truth)
    tracks.nodes[70, :, 1] += 40.0
    tracks.nodes[180, :, 1] += 80.0
    (verdict,) = evaluate(tracks, truth).moved
    assert worst_moment(verdict) == 70_000


@pytest.mark.shared_data
def test_picture_shows_the_events_of_the_last_five_milliseconds(shared_data):
    recording = shared_data / "single_dlo3_speed50"
    truth = load_ground_truth(recording / "ground_truth.npz")
    nothing = make_tracks(np.empty(0, np.int64), np.empty((0, 2, 2), np.float32))
    t_us = int(truth.times_us[truth.speed_mm_s[0].argmax()]) + 300
    shown = picture_at(recording, nothing, truth, t_us) != picture_at(shared_data, nothing, truth, t_us)
    events, _ = read_all(recording / "events.raw")
    events = events[(events["t"] > t_us - 5000) & (events["t"] <= t_us)]
    pixels = len(np.unique(events["y"].astype(int) * 1280 + events["x"]))
    # Truth and caption are drawn over some of them.
    assert 0.5 * pixels < int(shown.any(axis=2).sum()) <= pixels
