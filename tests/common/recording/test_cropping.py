"""A cropped recording is a recording: same events, frames and truth, with a time of its own."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from motiondlo.errors import RecordingError
from motiondlo.events.reader import read_all
from motiondlo.recording.cropping import crop_recording
from motiondlo.recording.layout import open_recording


@pytest.mark.shared_data
def test_a_span_keeps_what_belongs_to_it(shared_data: Path, tmp_path: Path) -> None:
    src = shared_data / "single_dlo1_speed5"
    count = crop_recording(src, tmp_path / "cut", 100_000, 250_000)
    events, triggers = read_all(tmp_path / "cut" / "events.raw")
    whole, _ = read_all(src / "events.raw")
    expected = whole[(whole["t"] >= 100_000) & (whole["t"] < 250_000)]
    assert count == len(events) == len(expected)
    np.testing.assert_array_equal(events["t"], expected["t"] - 100_000)
    cut = open_recording(tmp_path / "cut")
    assert len(cut.frames) == 3
    rising = triggers["t"][triggers["edge"] == 1]
    assert np.abs(rising - [f.t_us for f in cut.frames]).max() <= 10
    np.testing.assert_allclose(cut.event_from_rgb(), open_recording(src).event_from_rgb())
    with np.load(cut.ground_truth_path) as truth, np.load(src / "ground_truth.npz") as source:
        assert truth["times_us"][0] == 0
        np.testing.assert_array_equal(truth["nodes"][:, 5], source["nodes"][:, 105])
    with pytest.raises(RecordingError, match="exists already"):
        crop_recording(src, tmp_path / "cut", 0, 1)
