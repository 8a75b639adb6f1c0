"""Frames that nobody can use, through the core, with every backend: a named failure and no instance.

SAM 3 is stood for by a backend that is sure of the right mask whatever the picture is; the real one is tested in
tests/common/frames.
"""

from __future__ import annotations

from collections.abc import Callable

import cv2
import numpy as np
import pytest

from motiondlo.frames.backend import SegmenterBackend, create_backend
from motiondlo.frames.masks import MaskSet, ScoredMask
from motiondlo.frames.params import FrameParams
from motiondlo_services.segmenter.core import SegmenterCore

WIDTH, HEIGHT = 648, 486
MASK = cv2.line(np.zeros((HEIGHT, WIDTH), np.uint8), (100, 240), (540, 250), 1, 18)
RNG = np.random.default_rng(11)


class SureOfItself:
    """Always gives the mask of the cable as it lies in the good frame."""

    name = "sure"

    def segment(self, image_bgr, background, frame_name):
        return MaskSet((ScoredMask(MASK, 0.9),))


def noisy(picture):
    return np.clip(picture + RNG.normal(0.0, 1.5, picture.shape), 0, 255).astype(np.uint8)


def drawn() -> np.ndarray:
    big = np.full((4 * HEIGHT, 4 * WIDTH, 3), 205, np.uint8)
    cv2.line(big, (400, 960), (2160, 1000), (25, 30, 130), 72)
    return cv2.resize(big, (WIDTH, HEIGHT), interpolation=cv2.INTER_AREA).astype(np.float32)


GOOD = noisy(drawn())


def blurred() -> np.ndarray:
    """The cable moves across itself by 18 px during the exposure."""
    kernel = np.zeros((19, 19), np.float32)
    kernel[:, 9] = 1.0 / 19.0
    return noisy(cv2.filter2D(drawn(), -1, kernel))


def cut_short(fill: int) -> np.ndarray:
    frame = GOOD.copy()
    frame[200:] = fill
    return frame


BAD: dict[str, tuple[Callable[[], np.ndarray], str]] = {
    "BLACK": (lambda: noisy(np.full((HEIGHT, WIDTH, 3), 2.0)), "black"),
    "SATURATED": (lambda: np.full((HEIGHT, WIDTH, 3), 255, np.uint8), "saturated"),
    "MOTION_BLURRED": (blurred, "blurred"),
    "HALF_TRANSFERRED_GREY": (lambda: cut_short(128), "cut_short"),
    "HALF_TRANSFERRED_BLACK": (lambda: cut_short(0), "cut_short"),
    "OTHER_SIZE": (lambda: cv2.resize(GOOD, (WIDTH // 2, HEIGHT // 2)), "wrong_size"),
    "ONE_CHANNEL": (lambda: GOOD[:, :, 0], "wrong_size"),
}


@pytest.fixture(params=["classical", "replay", "onnx", "sure"])
def backend(request, tmp_path) -> SegmenterBackend:
    if request.param == "sure":
        return SureOfItself()
    if request.param == "replay":
        assert cv2.imwrite(str(tmp_path / "frame_000001.png"), MASK * 255)
        return create_backend(FrameParams(backend="replay", replay_folder=str(tmp_path)))
    if request.param == "onnx":
        return create_backend(FrameParams.model_validate({"backend": "onnx", "onnx": {"model": dark_things(tmp_path)}}))
    return create_backend(FrameParams())


def dark_things(folder) -> str:
    """An ONNX file that takes everything darker than 0.6 for a cable."""
    onnx = pytest.importorskip("onnx", reason="onnx is not installed (extra dev)")
    pytest.importorskip("onnxruntime", reason="onnxruntime is not installed (extra onnx)")
    image = onnx.helper.make_tensor_value_info("image", onnx.TensorProto.FLOAT, (1, 3, 243, 324))
    mask = onnx.helper.make_tensor_value_info("mask", onnx.TensorProto.FLOAT, None)
    constants = {"weights": np.full((1, 3, 1, 1), -10.0, np.float32), "bias": np.array([18.0], np.float32)}
    graph = onnx.helper.make_graph(
        [onnx.helper.make_node("Conv", ["image", "weights", "bias"], ["mask"])],
        "dark",
        [image],
        [mask],
        [onnx.numpy_helper.from_array(value, name) for name, value in constants.items()],
    )
    path = folder / "dark.onnx"
    opset = [onnx.helper.make_opsetid("", 17)]
    onnx.save(onnx.helper.make_model(graph, opset_imports=opset, ir_version=8), path)
    return str(path)


def core_with(backend: SegmenterBackend) -> SegmenterCore:
    return SegmenterCore(FrameParams(), backend, frame_size=(WIDTH, HEIGHT))


@pytest.mark.parametrize("bad", BAD)
def test_a_bad_frame_is_a_named_failure_without_instances(backend, bad):
    make, failure = BAD[bad]
    core = core_with(backend)
    result = core.on_frame(make(), 5, "frame_000001.jpg")
    assert result.failure == failure
    assert result.instances == ()
    assert core.counts[f"failure {failure}"] == 1
    assert sum(core.rejects.as_dict().values()) == 1


def test_the_good_frame_between_bad_ones_is_used_at_once(backend):
    core = core_with(backend)
    for name in BAD:
        core.on_frame(BAD[name][0](), 5, "frame_000001.jpg")
    assert core.degraded
    result = core.on_frame(GOOD, 6, "frame_000001.jpg")
    assert (result.failure, len(result.instances)) == ("", 1)
    assert not core.degraded
