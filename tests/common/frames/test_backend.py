"""Backends by name, and masks replayed from files."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from pydantic import ValidationError

from motiondlo.errors import ConfigError
from motiondlo.frames.backend import backend_names, create_backend
from motiondlo.frames.params import FrameParams

IMAGE = np.zeros((60, 80, 3), np.uint8)


def mask_file(path, value=255):
    path.parent.mkdir(parents=True, exist_ok=True)
    mask = np.zeros((30, 40), np.uint8)
    mask[10:14, 5:35] = value
    assert cv2.imwrite(str(path), mask)


def test_one_file_or_a_folder_of_instances_per_frame(tmp_path):
    mask_file(tmp_path / "frame_000001.png")
    mask_file(tmp_path / "frame_000002" / "a.png")
    mask_file(tmp_path / "frame_000002" / "b.png", value=90)
    backend = create_backend(FrameParams(backend="replay", replay_folder=str(tmp_path)))
    assert backend.name == "replay"
    (single,) = backend.segment(IMAGE, None, "frame_000001.jpg").masks
    assert int(single.mask.sum()) == 120
    assert [int(m.mask.sum()) for m in backend.segment(IMAGE, None, "frame_000002.jpg").masks] == [120, 0]
    assert backend.segment(IMAGE, None, "frame_000003.jpg").masks == ()
    assert backend.segment(IMAGE, None, "").masks == ()


def test_masks_of_another_shape_and_broken_files_are_left_out(tmp_path):
    mask_file(tmp_path / "frame_000001" / "good.png")
    (tmp_path / "frame_000001" / "broken.png").write_bytes(b"no picture")
    assert cv2.imwrite(str(tmp_path / "frame_000001" / "square.png"), np.zeros((500, 500), np.uint8))
    backend = create_backend(FrameParams(backend="replay", replay_folder=str(tmp_path)))
    assert len(backend.segment(IMAGE, None, "frame_000001.jpg").masks) == 1


def test_missing_folder_and_unknown_name_say_what_to_do():
    with pytest.raises(ConfigError, match="no such folder"):
        create_backend(FrameParams(backend="replay", replay_folder="/does/not/exist"))
    with pytest.raises(ConfigError, match="Choose one of"):
        create_backend(FrameParams(backend="magic"))
    assert {"classical", "replay"} <= set(backend_names())


def test_parameters_refuse_unknown_names_and_values_out_of_bounds():
    with pytest.raises(ValidationError, match="thresold"):
        FrameParams.model_validate({"foreground": {"thresold": 0.2}})
    with pytest.raises(ValidationError, match="less than or equal to 1000"):
        FrameParams.model_validate({"fit": {"nodes": 5000}})
