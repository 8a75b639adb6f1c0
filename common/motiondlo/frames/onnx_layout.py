"""What goes into an exported segmenter, and how its outputs are read. Arrays only."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

from motiondlo.errors import ConfigError
from motiondlo.frames.backend_params import OnnxParams
from motiondlo.frames.candidates import sigmoid

Image = npt.NDArray[np.uint8]
FloatArray = npt.NDArray[np.float32]

NumberType = type[np.float32] | type[np.float16] | type[np.uint8]

_NUMBER_TYPES: dict[str, NumberType] = {
    "tensor(float)": np.float32,
    "tensor(float16)": np.float16,
    "tensor(uint8)": np.uint8,
}


@dataclass(frozen=True)
class InputSpec:
    """The input that takes the image."""

    name: str
    width_px: int
    height_px: int
    number_type: NumberType


def input_spec(name: str, shape: list[int | str | None], number_type: str, params: OnnxParams) -> InputSpec:
    """Check the model's input against the configuration; ``shape`` as onnxruntime gives it, names for free axes.

    Raises ConfigError when it is no image of three colours, has another size than the configuration says, has a free
    size that the configuration does not fix, or is of a type other than float32, float16 and uint8.
    """
    where = f"onnx input {name!r} {shape} {number_type}"
    if number_type not in _NUMBER_TYPES:
        raise ConfigError(
            f"{where}: is of no type that an image can have.", "Export it with float32, float16 or uint8."
        )
    if len(shape) != 4:
        raise ConfigError(f"{where}: has not 4 axes.", "Export the model with an input (1, 3, height, width).")
    channels, height, width = (
        (shape[1], shape[2], shape[3]) if params.input_layout == "nchw" else (shape[3], shape[1], shape[2])
    )
    if channels != 3 and isinstance(channels, int):
        other = "nhwc" if params.input_layout == "nchw" else "nchw"
        raise ConfigError(
            f"{where}: {channels} colours in layout {params.input_layout}.", f'Set input_layout = "{other}"?'
        )
    if isinstance(shape[0], int) and shape[0] != 1:
        raise ConfigError(f"{where}: wants {shape[0]} images at once.", "Export the model for one image.")
    sizes = []
    for axis, fixed, wanted in (("width", width, params.input_width_px), ("height", height, params.input_height_px)):
        if isinstance(fixed, int) and fixed > 0:
            if wanted not in (0, fixed):
                raise ConfigError(
                    f"{where}: input_{axis}_px = {wanted}, but the model's is {fixed}.", f"Set input_{axis}_px = 0."
                )
            sizes.append(fixed)
        elif wanted == 0:
            raise ConfigError(f"{where}: the {axis} is free.", f"Set input_{axis}_px in [segmenter.onnx].")
        else:
            sizes.append(wanted)
    return InputSpec(name, sizes[0], sizes[1], _NUMBER_TYPES[number_type])


def prepare_image(image_bgr: Image, spec: InputSpec, params: OnnxParams) -> npt.NDArray[np.generic]:
    """(H, W, 3) uint8 BGR -> the model's input (1, 3, h, w) or (1, h, w, 3); the aspect is not kept."""
    shrinks = image_bgr.shape[1] > spec.width_px
    small = cv2.resize(
        image_bgr, (spec.width_px, spec.height_px), interpolation=cv2.INTER_AREA if shrinks else cv2.INTER_LINEAR
    )
    if params.input_channels == "rgb":
        small = small[:, :, ::-1]
    if spec.number_type is np.uint8:
        scaled: npt.NDArray[np.generic] = np.asarray(small)
    else:
        mean, std = np.array(params.input_mean, np.float32), np.array(params.input_std, np.float32)
        values = (small.astype(np.float32) * np.float32(params.input_scale) - mean) / std
        scaled = values.astype(spec.number_type)
    if params.input_layout == "nchw":
        scaled = scaled.transpose(2, 0, 1)
    return np.ascontiguousarray(scaled[None])


def read_binary(output: npt.NDArray[np.generic], name: str, params: OnnxParams) -> FloatArray:
    """Probability of "DLO" (a, b) from an output (a, b), (1, a, b), (1, C, a, b), or (1, a, b, C) in layout nhwc.

    Raises ConfigError when the output has another shape, or several channels of which none is chosen.
    """
    values = np.asarray(output)
    where = f"onnx output {name!r} {values.shape}"
    if values.ndim == 4 and values.shape[0] == 1:
        planes = values[0] if params.input_layout == "nchw" else values[0].transpose(2, 0, 1)
    elif values.ndim == 3 and values.shape[0] == 1:
        planes = values
    elif values.ndim == 2:
        planes = values[None]
    else:
        raise ConfigError(f"{where}: is no mask of one image.", "Name the right one: mask_output in [segmenter.onnx].")
    if params.mask_activation == "labels":
        if len(planes) != 1 or params.mask_channel < 0:
            raise ConfigError(
                f"{where}: labels need one plane, and the DLOs' label.", "Set mask_channel to the label of DLOs."
            )
        return np.asarray(planes[0] == params.mask_channel, dtype=np.float32)
    if len(planes) > 1 and not 0 <= params.mask_channel < len(planes):
        raise ConfigError(
            f"{where}: has {len(planes)} channels, and mask_channel = {params.mask_channel} is none of them.",
            "Set mask_channel in [segmenter.onnx] to the one of DLOs.",
        )
    likely = activate(planes.astype(np.float32), params.mask_activation)
    return np.asarray(likely[max(params.mask_channel, 0) % len(planes)], dtype=np.float32)


def read_instances(
    masks: npt.NDArray[np.generic], scores: npt.NDArray[np.generic] | None, name: str, params: OnnxParams
) -> tuple[FloatArray, FloatArray]:
    """Probabilities (N, a, b) and scores (N,) from outputs (..., N, a, b) and (..., N), axes of length 1 in between.

    Raises ConfigError for an output with fewer than 3 axes, or another number of scores than of masks.
    """
    values = np.asarray(masks)
    if values.ndim < 3:
        raise ConfigError(
            f"onnx output {name!r} {values.shape}: holds no instances.", 'Set task = "binary", or another mask_output.'
        )
    planes = activate(values.reshape(-1, *values.shape[-2:]).astype(np.float32), params.mask_activation)
    if scores is None:
        return planes, np.ones(len(planes), np.float32)
    sure = np.asarray(scores).reshape(-1).astype(np.float32)
    if len(sure) != len(planes):
        raise ConfigError(
            f"onnx outputs {name!r} {values.shape} and {params.score_output!r} {np.shape(scores)}: "
            f"{len(planes)} masks, {len(sure)} scores.",
            "Name the right ones: mask_output and score_output in [segmenter.onnx].",
        )
    return planes, sigmoid(sure) if params.score_activation == "sigmoid" else sure


def activate(planes: FloatArray, activation: str) -> FloatArray:
    """(C, a, b) raw values -> 0..1."""
    if activation == "sigmoid":
        return sigmoid(planes)
    if activation == "softmax":
        raised = np.exp(planes - planes.max(axis=0))
        return np.asarray(raised / raised.sum(axis=0), dtype=np.float32)
    return planes
