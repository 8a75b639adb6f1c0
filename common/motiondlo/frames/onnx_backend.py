"""Backend ``onnx``: any exported segmenter that onnxruntime can run, binary or with instances."""

from __future__ import annotations

import importlib.util
from pathlib import Path
from time import perf_counter_ns
from typing import Any

import numpy as np
import numpy.typing as npt

from motiondlo.errors import ConfigError
from motiondlo.frames.backend_params import OnnxParams
from motiondlo.frames.candidates import harden, keep_candidates, surest, working_shape
from motiondlo.frames.masks import MaskSet, ScoredMask
from motiondlo.frames.onnx_layout import Image, input_spec, prepare_image, read_binary, read_instances

Feed = dict[str, npt.NDArray[np.generic]]

HOW_TO_INSTALL = "Install it: pip install 'motiondlo[onnx]'."
_PROVIDERS = {"cpu": "CPUExecutionProvider", "cuda": "CUDAExecutionProvider"}


class OnnxBackend:
    """One ONNX file; inputs and outputs are checked against the configuration when this is made."""

    def __init__(self, params: OnnxParams, work_width_px: int) -> None:
        """Loads the file, and runs it once on a grey image.

        Raises ConfigError when the package or a file is missing, the file cannot be loaded or run, or its inputs and
        outputs are not as the configuration says.
        """
        check_onnx(params)
        self._params = params
        self._work_width_px = work_width_px
        self._session = _open(params)
        inputs = {item.name: item for item in self._session.get_inputs()}
        self._outputs = [item.name for item in self._session.get_outputs()]
        image = inputs.get(params.input_name or next(iter(inputs), ""))
        if image is None:
            raise ConfigError(
                f"onnx input_name {params.input_name!r}: no such input.", f"The model has: {', '.join(inputs)}."
            )
        self._mask_output = params.mask_output or self._outputs[0]
        for name in (self._mask_output, params.score_output):
            if name and name not in self._outputs:
                raise ConfigError(
                    f"onnx output {name!r}: no such output.", f"The model has: {', '.join(self._outputs)}."
                )
        self._spec = input_spec(image.name, list(image.shape), image.type, params)
        self._runs = _further_inputs(params, set(inputs) - {image.name})
        try:
            self._candidates(np.full((64, 64, 3), 128, np.uint8), {})
        except ConfigError:
            raise
        except Exception as error:
            raise ConfigError(
                f"onnx model {params.model}: does not run: {_first_line(error)}.",
                "Compare [segmenter.onnx] with the model's inputs.",
            ) from error

    @property
    def name(self) -> str:
        """``onnx``."""
        return "onnx"

    def segment(self, image_bgr: Image, background: Image | None, frame_name: str) -> MaskSet:
        """Masks at working size, the largest first, each with its score (1 for a binary model)."""
        stages_ns: dict[str, int] = {}
        masks = self._candidates(image_bgr, stages_ns)
        return MaskSet(masks, stages_ns=stages_ns)

    def _candidates(self, image_bgr: Image, stages_ns: dict[str, int]) -> tuple[ScoredMask, ...]:
        params = self._params
        began_ns = perf_counter_ns()
        pixels = prepare_image(image_bgr, self._spec, params)
        prepared_ns = perf_counter_ns()
        names = [self._mask_output, *([params.score_output] if params.score_output else [])]
        answers = [self._session.run(names, {self._spec.name: pixels, **feed}) for feed in self._runs]
        ran_ns = perf_counter_ns()
        shape = working_shape(image_bgr.shape, self._work_width_px)
        threshold = params.candidates.mask_threshold
        masks: list[ScoredMask] = []
        for answer in answers:
            if params.task == "binary":
                plane = read_binary(answer[0], self._mask_output, params)
                masks.append(ScoredMask(harden(plane, shape, threshold), 1.0))
                continue
            planes, scores = read_instances(
                answer[0], answer[1] if params.score_output else None, self._mask_output, params
            )
            masks += [
                ScoredMask(harden(planes[k], shape, threshold), float(np.clip(scores[k], 0.0, 1.0)))
                for k in surest(scores, params.candidates)
            ]
        kept = keep_candidates(tuple(masks), params.candidates)
        stages_ns["resize"] = prepared_ns - began_ns
        stages_ns["model"] = ran_ns - prepared_ns
        stages_ns["candidates"] = perf_counter_ns() - ran_ns
        return kept


def check_onnx(params: OnnxParams) -> None:
    """Package and files. Raises ConfigError for what is missing."""
    if importlib.util.find_spec("onnxruntime") is None:
        raise ConfigError("backend onnx needs onnxruntime.", HOW_TO_INSTALL)
    if not params.model or not Path(params.model).expanduser().is_file():
        raise ConfigError(f"onnx model {params.model!r}: no such file.", "Set [segmenter.onnx] model to the ONNX file.")
    if params.further_inputs and not Path(params.further_inputs).expanduser().is_file():
        raise ConfigError(f"onnx further_inputs {params.further_inputs!r}: no such file.", "Give an npz file.")


def _open(params: OnnxParams) -> Any:
    import onnxruntime

    path = Path(params.model).expanduser()
    provider = _PROVIDERS[params.provider]
    if provider not in onnxruntime.get_available_providers():
        raise ConfigError(
            f"onnx provider {params.provider!r}: this onnxruntime does not have it.",
            'Install onnxruntime-gpu, or set provider = "cpu".',
        )
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = params.threads
    options.inter_op_num_threads = 1
    # Threads that spin while they wait would take a processor from the event path.
    options.add_session_config_entry("session.intra_op.allow_spinning", "0")
    options.log_severity_level = 3
    try:
        return onnxruntime.InferenceSession(str(path), options, providers=[provider])
    except Exception as error:
        raise ConfigError(
            f"onnx model {path}: cannot be loaded: {_first_line(error)}.", "Export it again, or update onnxruntime."
        ) from error


def _further_inputs(params: OnnxParams, names: set[str]) -> list[Feed]:
    """One feed per run: ``NAME`` is the same in all of them, ``NAME/k`` is for run k."""
    arrays: Feed = {}
    if params.further_inputs:
        try:
            with np.load(Path(params.further_inputs).expanduser(), allow_pickle=False) as file:
                arrays = {key: np.asarray(file[key]) for key in file.files}
        except (OSError, ValueError) as error:
            raise ConfigError(
                f"onnx further_inputs {params.further_inputs!r}: cannot be read ({_first_line(error)}).",
                "Give an npz file.",
            ) from error
    count = 1 + max((int(key.rpartition("/")[2]) for key in arrays if key.rpartition("/")[2].isdecimal()), default=0)
    runs = []
    for k in range(count):
        feed = {}
        for name in sorted(names):
            value = arrays.get(f"{name}/{k}", arrays.get(name))
            if value is None:
                raise ConfigError(
                    f"onnx input {name!r}: nothing is given for it (run {k}).",
                    f"Put an array {name} into the npz file of further_inputs in [segmenter.onnx].",
                )
            feed[name] = value
        runs.append(feed)
    return runs


def _first_line(error: BaseException) -> str:
    lines = str(error).strip().splitlines()
    return (lines[0] if lines else type(error).__name__).rstrip(".")
