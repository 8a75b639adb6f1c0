"""Backend onnx with small files made here of real operators."""

from __future__ import annotations

import numpy as np
import pytest

from motiondlo.errors import ConfigError
from motiondlo.frames.backend import create_backend
from motiondlo.frames.backend_params import CandidateParams, OnnxParams
from motiondlo.frames.onnx_layout import input_spec, read_binary, read_instances
from motiondlo.frames.params import FrameParams
from motiondlo.frames.pipeline import StageTimes, segment_frame
from motiondlo.geometry.curve import distance_to_curve

onnx = pytest.importorskip("onnx", reason="onnx is not installed (extra dev)")
pytest.importorskip("onnxruntime", reason="onnxruntime is not installed (extra onnx)")

FLOAT = onnx.TensorProto.FLOAT
SIZE = (243, 324)
# A dark cable on a light board: 20 * (0.45 - mean of the colours).
WEIGHTS = np.full((1, 3, 1, 1), -20.0 / 3.0, np.float32)


def save(path, nodes, inputs, outputs, **constants):
    graph = onnx.helper.make_graph(
        nodes,
        "segmenter",
        [onnx.helper.make_tensor_value_info(name, kind, shape) for name, kind, shape in inputs],
        [onnx.helper.make_tensor_value_info(name, FLOAT, None) for name in outputs],
        [onnx.numpy_helper.from_array(value, name) for name, value in constants.items()],
    )
    model = onnx.helper.make_model(graph, opset_imports=[onnx.helper.make_opsetid("", 17)], ir_version=8)
    onnx.save(model, path)
    return str(path)


def binary(path, shape=(1, 3, *SIZE), kind=FLOAT):
    nodes = [onnx.helper.make_node("Conv", ["image", "weights", "bias"], ["mask"])]
    return save(path, nodes, [("image", kind, shape)], ["mask"], weights=WEIGHTS, bias=np.array([9.0], np.float32))


def instances(path):
    """Left and right half of the same foreground are two instances; a third one has a low score."""
    halves = np.full((1, 3, *SIZE), -30.0, np.float32)
    halves[0, 0, :, :160] = halves[0, 1, :, 166:] = halves[0, 2] = 0.0
    nodes = [
        onnx.helper.make_node("Conv", ["image", "weights", "bias"], ["one"]),
        onnx.helper.make_node("Add", ["one", "halves"], ["masks"]),
        onnx.helper.make_node("Identity", ["sure"], ["scores"]),
    ]
    return save(
        path,
        nodes,
        [("image", FLOAT, (1, 3, *SIZE))],
        ["scores", "masks"],
        weights=WEIGHTS,
        bias=np.array([9.0], np.float32),
        halves=halves,
        sure=np.array([[3.0, 1.0, -3.0]], np.float32),
    )


def prompted(path):
    """The prompt chooses the colour: one weight per channel."""
    nodes = [
        onnx.helper.make_node("Mul", ["image", "prompt"], ["part"]),
        onnx.helper.make_node("ReduceSum", ["part", "axis"], ["mask"], keepdims=1),
    ]
    inputs = [("image", FLOAT, (1, 3, *SIZE)), ("prompt", FLOAT, (1, 3, 1, 1))]
    return save(path, nodes, inputs, ["mask"], axis=np.array([1], np.int64))


def backend(model, **changes):
    return create_backend(FrameParams(backend="onnx", onnx=OnnxParams(model=model, **changes)))


@pytest.fixture
def scene(make_board, curves):
    board = make_board((0.7, 0.72, 0.72))
    truth = board.cable(curves["wave"](80, 560, 240, 60), 18.0, (0.03, 0.03, 0.03))
    return board.photograph(), truth


def test_a_binary_model_gives_the_polyline_of_a_cable(tmp_path, scene):
    image, truth = scene
    params = FrameParams(backend="onnx", onnx=OnnxParams(model=binary(tmp_path / "m.onnx")))
    times = StageTimes()
    result = segment_frame(image, None, None, params, 1, "a", create_backend(params), times)
    (cable,) = result.instances
    assert (result.failure, result.backend) == ("", "onnx")
    assert distance_to_curve(truth, cable.nodes_rgb).mean() < 0.4
    assert {"segment.resize", "segment.model", "segment.candidates"} <= set(times.ns)


def test_instances_stay_apart_with_their_scores_and_unsure_ones_go(tmp_path, scene):
    model = backend(
        instances(tmp_path / "m.onnx"), task="instances", mask_output="masks", score_output="scores"
    ).segment(scene[0], None, "a")
    left, right = sorted(model.masks, key=lambda m: int(np.flatnonzero(m.mask.any(axis=0))[0]))
    assert left.score == pytest.approx(0.953, abs=0.001)
    assert right.score == pytest.approx(0.731, abs=0.001)
    assert left.mask.shape == (486, 648)
    assert not (left.mask & right.mask).any()
    everything = CandidateParams(min_score=0.0)
    all_three = backend(
        instances(tmp_path / "m.onnx"),
        task="instances",
        mask_output="masks",
        score_output="scores",
        candidates=everything,
    ).segment(scene[0], None, "a")
    assert len(all_three.masks) == 3


def test_a_prompted_model_runs_once_per_prompt_of_the_file(tmp_path):
    image = np.zeros((486, 648, 3), np.uint8)
    image[100:160, 50:600] = (0, 0, 255)
    image[300:330, 50:600] = (0, 255, 0)
    red, green = np.zeros((2, 1, 3, 1, 1), np.float32)
    red[0, :, 0, 0], green[0, :, 0, 0] = (9, -9, -9), (-9, 9, -9)
    np.savez(tmp_path / "prompts.npz", **{"prompt/0": red, "prompt/1": green})
    model = prompted(tmp_path / "m.onnx")
    found = backend(model, further_inputs=str(tmp_path / "prompts.npz"), candidates=CandidateParams(mask_threshold=0.9))
    masks = found.segment(image, None, "a").masks
    assert [int(m.mask.sum()) for m in masks] == [pytest.approx(33000, rel=0.05), pytest.approx(16500, rel=0.1)]
    with pytest.raises(ConfigError, match=r"'prompt': nothing is given"):
        backend(model)


def test_size_and_channels_last_come_from_the_configuration(tmp_path, scene):
    free = binary(tmp_path / "free.onnx", (1, 3, "height", "width"))
    with pytest.raises(ConfigError, match="the width is free"):
        backend(free)
    (mask,) = backend(free, input_width_px=324, input_height_px=243).segment(scene[0], None, "a").masks
    nodes = [
        onnx.helper.make_node("Transpose", ["image"], ["planes"], perm=[0, 3, 1, 2]),
        onnx.helper.make_node("Conv", ["planes", "weights", "bias"], ["one"]),
        onnx.helper.make_node("Transpose", ["one"], ["mask"], perm=[0, 2, 3, 1]),
    ]
    inputs = [("image", FLOAT, (1, *SIZE, 3))]
    last = save(tmp_path / "l.onnx", nodes, inputs, ["mask"], weights=WEIGHTS, bias=np.array([9.0], np.float32))
    (same,) = backend(last, input_layout="nhwc").segment(scene[0], None, "a").masks
    np.testing.assert_array_equal(mask.mask, same.mask)


@pytest.mark.parametrize(
    ("shape", "changes", "complaint"),
    [
        ((1, 3, *SIZE), {"input_layout": "nhwc"}, r'input_layout = "nchw"'),
        ((1, 3, *SIZE), {"input_width_px": 100}, r"input_width_px = 100, but the model's is 324"),
        ((1, 3, *SIZE), {"input_name": "x"}, r"'x': no such input. The model has: image"),
        ((1, 3, *SIZE), {"mask_output": "x"}, r"'x': no such output. The model has: mask"),
        ((4, 3, *SIZE), {}, r"wants 4 images at once"),
    ],
)
def test_a_model_that_does_not_fit_the_configuration_is_refused_at_the_start(tmp_path, shape, changes, complaint):
    with pytest.raises(ConfigError, match=complaint):
        backend(binary(tmp_path / "m.onnx", shape), **changes)


def test_inputs_that_are_no_image_are_refused():
    with pytest.raises(ConfigError, match="has not 4 axes"):
        input_spec("image", [3, 243, 324], "tensor(float)", OnnxParams())
    with pytest.raises(ConfigError, match="no type that an image can have"):
        input_spec("image", [1, 3, 243, 324], "tensor(string)", OnnxParams())


def test_missing_and_broken_files_say_what_to_do(tmp_path):
    with pytest.raises(ConfigError, match=r"no such file.*\[segmenter\.onnx\] model"):
        backend("")
    with pytest.raises(ConfigError, match="no such file"):
        backend(str(tmp_path / "none.onnx"))
    (tmp_path / "broken.onnx").write_bytes(b"no model at all")
    with pytest.raises(ConfigError, match="cannot be loaded"):
        backend(str(tmp_path / "broken.onnx"))
    with pytest.raises(ConfigError, match=r"further_inputs.*no such file"):
        backend(binary(tmp_path / "m.onnx"), further_inputs="none.npz")
    (tmp_path / "broken.npz").write_bytes(b"no arrays")
    with pytest.raises(ConfigError, match="cannot be read"):
        backend(binary(tmp_path / "m.onnx"), further_inputs=str(tmp_path / "broken.npz"))


@pytest.mark.parametrize("shape", [(4, 6), (1, 4, 6), (1, 1, 4, 6), (1, 3, 4, 6)])
def test_binary_outputs_of_every_usual_shape(shape):
    channel = 2 if shape == (1, 3, 4, 6) else -1
    output = np.zeros(shape, np.float32)
    output[..., 1, 2] = -5.0
    if channel == 2:
        output[0, 2, 1, 2] = 5.0
    params = OnnxParams(mask_channel=channel)
    plane = read_binary(output, "mask", params)
    assert plane.shape == (4, 6)
    assert plane[1, 2] == pytest.approx(0.9933 if channel == 2 else 0.0067, abs=1e-3)


def test_channels_softmax_and_labels():
    logits = np.zeros((1, 2, 4, 6), np.float32)
    logits[0, 1, 1, 2] = 3.0
    plane = read_binary(logits, "m", OnnxParams(mask_channel=1, mask_activation="softmax"))
    assert plane[1, 2] == pytest.approx(0.9526, abs=1e-3)
    assert plane[0, 0] == pytest.approx(0.5)
    with pytest.raises(ConfigError, match="has 2 channels"):
        read_binary(logits, "m", OnnxParams())
    labels = np.zeros((1, 4, 6), np.int64)
    labels[0, 1, 2] = 7
    plane = read_binary(labels, "m", OnnxParams(mask_channel=7, mask_activation="labels"))
    assert float(plane.sum()) == float(plane[1, 2]) == 1.0
    with pytest.raises(ConfigError, match="is no mask of one image"):
        read_binary(np.zeros((2, 1, 4, 6), np.float32), "m", OnnxParams())


def test_masks_and_scores_that_do_not_belong_together_are_refused():
    masks = np.zeros((1, 3, 4, 6), np.float32)
    with pytest.raises(ConfigError, match="3 masks, 5 scores"):
        read_instances(masks, np.zeros((1, 5), np.float32), "m", OnnxParams(score_output="s"))
    with pytest.raises(ConfigError, match="holds no instances"):
        read_instances(np.zeros((4, 6), np.float32), None, "m", OnnxParams())
    planes, scores = read_instances(masks, None, "m", OnnxParams(score_output=""))
    assert planes.shape == (3, 4, 6)
    assert scores.tolist() == [1.0, 1.0, 1.0]
