from __future__ import annotations

import numpy as np
import pytest

from motiondlo.offline.tracks import TracksBuilder, TracksError, load_tracks, make_tracks

TIMES_US = np.array([0, 1000, 1000], np.int64)
NODES = np.zeros((3, 4, 2), np.float32) + np.arange(4, dtype=np.float32)[None, :, None]


def test_saved_tracks_come_back_unchanged(tmp_path):
    saved = make_tracks(
        TIMES_US,
        NODES,
        ids=np.array([3, 3, 8]),
        valid=np.array([True, False, True]),
        sigma_px=np.full((3, 4), 0.5, np.float32),
        source=np.array(["event", "frame", "predicted"]),
    )
    saved.save(tmp_path / "tracks.npz")
    loaded = load_tracks(tmp_path / "tracks.npz")
    for field in ("times_us", "nodes", "ids", "valid", "sigma_px", "source"):
        np.testing.assert_array_equal(getattr(loaded, field), getattr(saved, field))
    assert loaded.nodes.dtype == np.float32
    assert loaded.known_ids() == (3, 8)
    assert loaded.estimates_of(3).tolist() == [0]


def test_times_and_nodes_alone_are_enough(tmp_path):
    np.savez(tmp_path / "minimal.npz", times_us=TIMES_US, nodes=NODES)
    tracks = load_tracks(tmp_path / "minimal.npz")
    assert tracks.ids.tolist() == [0, 0, 0]
    assert tracks.valid.all()
    assert np.isnan(tracks.sigma_px).all()


@pytest.mark.parametrize(
    ("change", "complaint"),
    [
        ({"nodes": NODES[:, :, 0]}, "nodes"),
        ({"nodes": NODES[:2]}, "nodes"),
        ({"nodes": NODES[:, :1]}, "at least 2"),
        ({"nodes": NODES.astype(np.int32)}, "nodes"),
        ({"times_us": TIMES_US.astype(float)}, "times_us"),
        ({"times_us": TIMES_US[::-1].copy()}, "backwards"),
        ({"ids": np.zeros(2, np.int64)}, "ids"),
        ({"valid": np.ones(3)}, "valid"),
        ({"sigma_px": np.ones((3, 5))}, "sigma_px"),
        ({"source": np.zeros(3)}, "source"),
    ],
)
def test_wrong_array_is_named_with_its_file(tmp_path, change, complaint):
    path = tmp_path / "wrong.npz"
    np.savez(path, **({"times_us": TIMES_US, "nodes": NODES} | change))
    with pytest.raises(TracksError, match=complaint) as caught:
        load_tracks(path)
    assert str(path) in str(caught.value)


@pytest.mark.parametrize("content", [b"", b"no archive at all", b"PK\x03\x04 cut short"])
def test_file_that_is_no_archive(tmp_path, content):
    path = tmp_path / "bad.npz"
    path.write_bytes(content)
    with pytest.raises(TracksError, match=r"bad\.npz"):
        load_tracks(path)


def test_absent_file_and_absent_array(tmp_path):
    with pytest.raises(TracksError, match="motiondlo track"):
        load_tracks(tmp_path / "absent.npz")
    np.savez(tmp_path / "empty.npz", times_us=TIMES_US)
    with pytest.raises(TracksError, match="no array nodes"):
        load_tracks(tmp_path / "empty.npz")


def test_save_into_an_absent_folder_is_one_clear_error(tmp_path):
    with pytest.raises(TracksError, match="cannot be written"):
        make_tracks(TIMES_US, NODES).save(tmp_path / "absent" / "tracks.npz")


def test_builder_resamples_shorter_chains_to_the_longest():
    builder = TracksBuilder()
    builder.add(0, 1, np.array([[0.0, 0.0], [4.0, 0.0], [8.0, 0.0]]), np.array([1.0, 2.0, 3.0]), "event")
    builder.add(0, 2, np.array([[0.0, 9.0], [8.0, 9.0]]), np.array([1.0, 3.0]), "predicted")
    tracks = builder.build()
    assert tracks.nodes[1].tolist() == [[0.0, 9.0], [4.0, 9.0], [8.0, 9.0]]
    assert tracks.sigma_px[1].tolist() == [1.0, 2.0, 3.0]
    assert tracks.source.tolist() == ["event", "predicted"]


def test_builder_without_rows_gives_empty_tracks():
    assert len(TracksBuilder().build()) == 0
