from __future__ import annotations

import numpy as np
import pytest

from motiondlo.errors import RecordingError
from motiondlo.offline.ground_truth import load_ground_truth


def _arrays(truth):
    return {
        "times_us": truth.times_us,
        "nodes": truth.nodes,
        "visibility": truth.visibility,
        "moving": truth.moving,
        "moved": truth.moved,
        "speed_mm_s": truth.speed_mm_s,
        "px_per_mm": np.float64(truth.px_per_mm),
        "names": np.array(truth.names),
    }


def test_truth_is_interpolated_and_held_past_its_ends(tmp_path, make_truth):
    np.savez(tmp_path / "truth.npz", **_arrays(make_truth(speeds_px_ms=(2.0,), duration_ms=10)))
    truth = load_ground_truth(tmp_path / "truth.npz")
    y = truth.nodes_at(0, np.array([-5000, 0, 2250, 10_000, 99_000]))[:, 0, 1]
    np.testing.assert_allclose(y, [100.0, 100.0, 104.5, 120.0, 120.0], atol=1e-4)
    assert truth.nearest_index(np.array([-9, 400, 600, 99_000])).tolist() == [0, 0, 1, 10]


@pytest.mark.parametrize(
    ("change", "complaint"),
    [
        ({"nodes": np.zeros((1, 11, 2))}, "nodes"),
        ({"moving": np.zeros((2, 11), bool)}, "moving"),
        ({"visibility": np.zeros((1, 11, 3), np.uint8)}, "visibility"),
        ({"px_per_mm": np.float64(0.0)}, "px_per_mm"),
        ({"times_us": np.zeros(11, np.int64)}, "does not increase"),
    ],
)
def test_wrong_array_is_named_with_its_file(tmp_path, make_truth, change, complaint):
    path = tmp_path / "truth.npz"
    np.savez(path, **(_arrays(make_truth(duration_ms=10)) | change))
    with pytest.raises(RecordingError, match=complaint) as caught:
        load_ground_truth(path)
    assert str(path) in str(caught.value)


def test_absent_file_absent_array_and_damaged_file(tmp_path, make_truth):
    with pytest.raises(RecordingError, match="no such file"):
        load_ground_truth(tmp_path / "absent.npz")
    arrays = _arrays(make_truth(duration_ms=10))
    del arrays["moving"]
    np.savez(tmp_path / "lacks.npz", **arrays)
    with pytest.raises(RecordingError, match="no array moving"):
        load_ground_truth(tmp_path / "lacks.npz")
    (tmp_path / "damaged.npz").write_bytes(b"PK")
    with pytest.raises(RecordingError, match="not a readable"):
        load_ground_truth(tmp_path / "damaged.npz")
