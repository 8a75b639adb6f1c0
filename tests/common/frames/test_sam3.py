"""Backend sam3 with the real model code of transformers, tiny and with random weights, on the processor.

For the whole path to polylines the last layer, and only that, is fitted to the picture by least squares.
"""

from __future__ import annotations

import subprocess
import sys

import cv2
import numpy as np
import pytest

from motiondlo.errors import ConfigError
from motiondlo.frames.backend import create_backend
from motiondlo.frames.backend_params import CandidateParams, Sam3Params
from motiondlo.frames.params import FrameParams
from motiondlo.frames.pipeline import StageTimes, segment_frame
from motiondlo.frames.sam3_backend import Sam3Backend
from motiondlo.frames.sam3_model import ModelTimes, Sam3Network, load_network
from motiondlo.frames.sam3_random import byte_tokenizer, random_network, tiny_config
from motiondlo.frames.sam3_weights import missing_packages
from motiondlo.geometry.curve import distance_to_curve

ABSENT = missing_packages()
needs_sam3 = pytest.mark.skipif(bool(ABSENT), reason=f"extra sam3 is not installed: {', '.join(ABSENT)}")
NOISE = np.random.default_rng(5).integers(0, 255, (243, 324, 3)).astype(np.uint8)
CPU = Sam3Params(device="cpu", candidates=CandidateParams(min_score=0.0))


def with_model(folder, **changes):
    return FrameParams(backend="sam3", sam3=CPU.model_copy(update={"model": str(folder), **changes}))


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A tiny model as the hub's folders are."""
    path = tmp_path_factory.mktemp("sam3")
    import torch
    from transformers import Sam3Model

    torch.set_num_threads(1)
    torch.manual_seed(0)
    Sam3Model(tiny_config()).save_pretrained(path)
    byte_tokenizer().save_pretrained(path)
    return path


def teach(model, image, centre, width):
    """Fit the mask decoder's last projection so that it shows the DLO of one picture; the rest stays random."""
    import torch

    features = []
    decoder = model.mask_decoder
    hook = decoder.instance_projection.register_forward_pre_hook(lambda _, args: features.append(args[0][0]))
    network = Sam3Network(model, byte_tokenizer(), ("cable",), torch.device("cpu"), torch.float32)
    network.find(image, lambda scores: np.arange(1), ModelTimes())
    hook.remove()
    planes = features[0].numpy()
    drawn = np.zeros(image.shape[:2], np.float32)
    cv2.polylines(drawn, [np.round(8 * centre).astype(np.int32).reshape(-1, 1, 2)], False, 1.0, width, cv2.LINE_AA, 3)
    wanted = cv2.resize(drawn, planes.shape[:0:-1], interpolation=cv2.INTER_AREA).ravel() - 0.4
    known = np.c_[planes.reshape(len(planes), -1).T, np.ones(planes[0].size)]
    weights = np.linalg.lstsq(known, wanted, rcond=None)[0] * 10.0
    with torch.no_grad():
        last = decoder.mask_embedder.layers[-1]
        for parameter in (last.weight, last.bias, decoder.instance_projection.weight, decoder.instance_projection.bias):
            parameter.zero_()
        last.bias[0] = 1.0
        decoder.instance_projection.weight[0, :, 0, 0] = torch.as_tensor(weights[:-1])
        decoder.instance_projection.bias[0] = float(weights[-1])


@needs_sam3
def test_from_a_folder_of_weights_to_the_polyline_of_a_cable(tmp_path, make_board, curves):
    import torch
    from transformers import Sam3Model

    board = make_board((0.7, 0.72, 0.72))
    truth = board.cable(curves["wave"](80, 560, 240, 60), 20.0, (0.05, 0.05, 0.45))
    image = board.photograph()
    torch.set_num_threads(1)
    torch.manual_seed(0)
    model = Sam3Model(tiny_config(patches=32, width=64)).eval()
    text_encoder = model.text_encoder
    teach(model, image, truth, 20)
    model.text_encoder = text_encoder
    model.save_pretrained(tmp_path)
    byte_tokenizer().save_pretrained(tmp_path)

    params = with_model(tmp_path, prompts=("cable",))
    times = StageTimes()
    result = segment_frame(image, None, None, params, 7, "frame_000001.jpg", create_backend(params), times)
    assert (result.failure, result.backend, result.t_us) == ("", "sam3", 7)
    (cable,) = result.instances
    assert distance_to_curve(truth, cable.nodes_rgb).mean() < 0.5
    assert {"segment.vision", "segment.prompts", "segment.candidates"} <= set(times.ns)
    assert result.elapsed_ms == pytest.approx(times.total_ms)


@needs_sam3
def test_image_features_are_computed_once_for_all_prompts_and_text_never_again():
    network = random_network(CPU, "tiny")
    calls = {"vision": 0, "decoder": 0}
    model = network._model

    def count(key):
        calls[key] += 1

    model.vision_encoder.register_forward_hook(lambda *_: count("vision"))
    model.detr_decoder.register_forward_hook(lambda *_: count("decoder"))
    times = ModelTimes()
    found = network.find(NOISE, lambda scores: np.arange(len(scores)), times)
    assert calls == {"vision": 1, "decoder": 5}
    assert {soft.prompt for soft in found} == {"cable", "wire", "hose", "tubing", "DLO"}
    assert list(times.ns) == ["resize", "vision", "prompts"]
    assert all(0.0 <= soft.score <= 1.0 and soft.probability.shape == (32, 32) for soft in found)


@needs_sam3
def test_prompts_matter_and_results_are_repeatable():
    network = random_network(CPU, "tiny")
    first, again = (network.find(NOISE, lambda s: np.arange(1), ModelTimes()) for _ in range(2))
    assert [soft.score for soft in first] == [soft.score for soft in again]
    assert len({soft.score for soft in first}) == 5


@needs_sam3
@pytest.mark.parametrize("precision", ["float16", "bfloat16"])
def test_half_precision_gives_nearly_the_same(precision):
    half = random_network(CPU.model_copy(update={"precision": precision}), "tiny")
    full = random_network(CPU, "tiny")
    for a, b in zip(*(n.find(NOISE, lambda s: np.arange(1), ModelTimes()) for n in (half, full)), strict=True):
        assert a.score == pytest.approx(b.score, abs=0.01)
        assert np.abs(a.probability - b.probability).mean() < 0.02


@needs_sam3
def test_masks_stay_apart_each_with_its_score_and_duplicates_of_prompts_are_gone():
    backend = Sam3Backend(CPU, 324, random_network(CPU, "tiny"))
    found = backend.segment(NOISE, None, "a")
    areas = [int(m.mask.sum()) for m in found.masks]
    assert 1 <= len(areas) < 20
    assert areas == sorted(areas, reverse=True)
    assert all(m.mask.shape == (243, 324) and 0.0 < m.score < 1.0 for m in found.masks)
    strict = CPU.model_copy(update={"candidates": CandidateParams(min_score=0.9)})
    assert Sam3Backend(strict, 324, random_network(CPU, "tiny")).segment(NOISE, None, "a").masks == ()


@needs_sam3
def test_a_folder_without_weights_or_with_something_else_says_what_to_do(folder, tmp_path):
    with pytest.raises(ConfigError, match=r"no such folder.*hf auth login"):
        load_network(CPU.model_copy(update={"model": str(tmp_path / "none")}))
    with pytest.raises(ConfigError, match=r"config\.json"):
        load_network(CPU.model_copy(update={"model": str(tmp_path)}))
    (tmp_path / "config.json").write_text('{"model_type": "bert"}')
    with pytest.raises(ConfigError, match="safetensors"):
        load_network(CPU.model_copy(update={"model": str(tmp_path)}))
    (tmp_path / "model.safetensors").write_bytes((folder / "model.safetensors").read_bytes())
    with pytest.raises(ConfigError, match="tokenizer"):
        load_network(CPU.model_copy(update={"model": str(tmp_path)}))
    (tmp_path / "tokenizer.json").write_bytes((folder / "tokenizer.json").read_bytes())
    with pytest.raises(ConfigError, match="'bert'"):
        load_network(CPU.model_copy(update={"model": str(tmp_path)}))


@needs_sam3
def test_weights_that_were_cut_short_or_are_incomplete_are_refused(folder, tmp_path):
    from safetensors.numpy import load_file, save_file

    for file in folder.iterdir():
        (tmp_path / file.name).write_bytes(file.read_bytes())
    weights = load_file(folder / "model.safetensors")
    weights.pop("text_projection.weight")
    save_file(weights, tmp_path / "model.safetensors", metadata={"format": "pt"})
    with pytest.raises(ConfigError, match="1 weights are missing"):
        load_network(CPU.model_copy(update={"model": str(tmp_path)}))
    data = (folder / "model.safetensors").read_bytes()
    (tmp_path / "model.safetensors").write_bytes(data[: len(data) // 2])
    with pytest.raises(ConfigError, match="cannot be loaded"):
        load_network(CPU.model_copy(update={"model": str(tmp_path)}))


@needs_sam3
def test_an_accelerator_that_is_not_there_is_named(folder):
    import torch

    index = torch.cuda.device_count()
    with pytest.raises(ConfigError, match=f"cuda:{index}"):
        create_backend(with_model(folder, device=f"cuda:{index}"))


def test_without_the_packages_the_backend_says_how_to_install_them(monkeypatch):
    monkeypatch.setattr("motiondlo.frames.sam3_weights.missing_packages", lambda: ("torch",))
    with pytest.raises(ConfigError, match=r"needs torch.*motiondlo\[sam3\]"):
        create_backend(FrameParams(backend="sam3"))


def test_nothing_but_the_backend_itself_imports_its_packages():
    code = (
        "import sys, motiondlo.frames.pipeline, motiondlo.tracking.factory, motiondlo_services.segmenter.daemon;"
        "sys.exit(bool({'torch', 'transformers', 'onnxruntime'} & set(sys.modules)))"
    )
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
