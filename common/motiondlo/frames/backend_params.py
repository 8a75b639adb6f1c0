"""Parameters of the segmenter backends that run a model: ``sam3`` and ``onnx``."""

from __future__ import annotations

from typing import Literal

from pydantic import BaseModel, ConfigDict, Field


class _Params(BaseModel):
    model_config = ConfigDict(frozen=True, strict=True, extra="forbid")


class CandidateParams(_Params):
    """Which of a model's masks are kept (paper, "SAM 3 Segmentation")."""

    min_score: float = Field(default=0.3, ge=0.0, le=1.0, description="masks that the model is less sure of go")
    mask_threshold: float = Field(default=0.5, ge=0.0, le=1.0, description="a pixel belongs to a mask from here on")
    min_area: float = Field(default=6e-4, ge=0.0, le=0.5, description="smaller masks go, share of the image's area")
    max_iou: float = Field(
        default=0.7, ge=0.0, le=1.0, description="of two masks that overlap more, the larger one stays"
    )
    max_candidates: int = Field(default=64, ge=1, le=1000, description="the surest so many are looked at")


class Sam3Params(_Params):
    """SAM 3 through Hugging Face transformers (``pip install motiondlo[sam3]``)."""

    model: str = Field(
        default="facebook/sam3", min_length=1, description="folder with config.json and weights, or a name on the hub"
    )
    prompts: tuple[str, ...] = Field(
        default=("cable", "wire", "hose", "tubing", "DLO"),
        min_length=1,
        max_length=32,
        description="what to look for; image features are computed once and shared by all prompts",
    )
    device: str = Field(
        default="auto",
        pattern=r"^(auto|cpu|cuda(:\d+)?)$",
        description="auto (cuda where there is one), cpu, cuda, cuda:N",
    )
    precision: Literal["auto", "float32", "float16", "bfloat16"] = Field(
        default="auto", description="auto: half precision on cuda, float32 on cpu; or float32, float16, bfloat16"
    )
    threads: int = Field(default=1, ge=1, le=256, description="processor threads of the model")
    candidates: CandidateParams = CandidateParams()


class OnnxParams(_Params):
    """Any exported segmenter as an ONNX file (``pip install motiondlo[onnx]``)."""

    model: str = Field(default="", description="the file")
    task: Literal["binary", "instances"] = Field(
        default="binary", description="binary: one mask with all DLOs; instances: one mask and one score per DLO"
    )
    input_name: str = Field(default="", description="input that takes the image; empty: the first one")
    input_layout: Literal["nchw", "nhwc"] = Field(default="nchw", description="order of the image's axes")
    input_channels: Literal["rgb", "bgr"] = Field(default="rgb", description="order of its colours")
    input_width_px: int = Field(default=0, ge=0, le=16384, description="0: what the model says")
    input_height_px: int = Field(default=0, ge=0, le=16384, description="0: what the model says")
    input_scale: float = Field(
        default=1.0 / 255.0, gt=0.0, le=1.0, description="the model sees (grey * scale - mean) / std"
    )
    input_mean: tuple[float, float, float] = Field(
        default=(0.0, 0.0, 0.0), description="per colour, in the model's order"
    )
    input_std: tuple[float, float, float] = Field(
        default=(1.0, 1.0, 1.0), description="per colour, in the model's order"
    )
    further_inputs: str = Field(
        default="",
        description="npz file with the other inputs by name (encoded prompts); NAME/0, NAME/1 ...: one run for each",
    )
    mask_output: str = Field(default="", description="output with the masks; empty: the first one")
    mask_channel: int = Field(
        default=-1, ge=-1, le=4096, description="binary: channel (or label) of the DLOs; -1: the only one"
    )
    mask_activation: Literal["none", "sigmoid", "softmax", "labels"] = Field(
        default="sigmoid",
        description="what makes a probability of the output: none, sigmoid, softmax over channels; or labels: a pixel "
        "is a DLO's where it equals mask_channel",
    )
    score_output: str = Field(default="", description="instances: output with one score per mask; empty: all are 1")
    score_activation: Literal["none", "sigmoid"] = Field(default="sigmoid", description="the same for scores")
    provider: Literal["cpu", "cuda"] = Field(default="cpu", description="cpu, or cuda (needs onnxruntime-gpu)")
    threads: int = Field(default=1, ge=1, le=256, description="processor threads of the model")
    candidates: CandidateParams = CandidateParams()
