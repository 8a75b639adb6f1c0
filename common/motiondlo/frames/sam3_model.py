"""SAM 3 in torch: one image and several text prompts in, soft masks with scores out (paper, "SAM 3 Segmentation").

Only this module and ``sam3_random`` import torch and transformers, and only inside their functions. Pre- and
post-processing are our own: those of transformers need torchvision.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import dataclass, field
from time import perf_counter_ns
from typing import Any

import numpy as np
import numpy.typing as npt

from motiondlo.errors import ConfigError
from motiondlo.frames.backend_params import Sam3Params
from motiondlo.frames.sam3_weights import HOW_TO_GET_WEIGHTS, MODEL_CLASSES, check_sam3

Image = npt.NDArray[np.uint8]
FloatArray = npt.NDArray[np.float32]
Tokenizer = Callable[..., Any]

_DEFAULT_TOKENS = 32


@dataclass(frozen=True)
class SoftMask:
    """One query's answer to one prompt."""

    probability: FloatArray
    """(a, b) float32 0..1 over the whole image, at the model's own size."""
    score: float
    prompt: str


@dataclass
class ModelTimes:
    """Host time per stage; an accelerator is waited for at the end of each."""

    ns: dict[str, int] = field(default_factory=dict)


class Sam3Network:
    """A loaded model with the features of its prompts."""

    def __init__(self, model: Any, tokenizer: Tokenizer, prompts: tuple[str, ...], device: Any, dtype: Any) -> None:
        """model: a Sam3Model of type ``dtype``; it is moved to ``device``, and its text encoder let go after use."""
        import torch

        self._torch = torch
        self._device, self._dtype = device, dtype
        self._model = model.eval().to(device)
        size = self._model.config.vision_config.backbone_config.image_size
        self.input_size = (size, size) if isinstance(size, int) else (int(size[0]), int(size[1]))
        """(height, width) to which every image is resized; its aspect is not kept."""
        self.parameters = sum(p.numel() for p in self._model.parameters())
        limit = getattr(self._model.config.text_config, "max_position_embeddings", _DEFAULT_TOKENS)
        self._prompts = [(prompt, *self._encode(prompt, tokenizer, min(limit, _DEFAULT_TOKENS))) for prompt in prompts]
        # The prompts never change, so that the text encoder (353 M parameters) has done its work.
        self._model.text_encoder = torch.nn.Identity()

    @property
    def runs_on(self) -> str:
        """Device, number type, parameters; and what they took of an accelerator's memory at most."""
        parts = [
            str(self._device),
            str(self._dtype).removeprefix("torch."),
            f"{self.parameters / 1e6:.1f} M parameters",
        ]
        if self._device.type == "cuda":
            parts[0] = self._torch.cuda.get_device_name(self._device)
            parts.append(f"{self._torch.cuda.max_memory_allocated(self._device) / 2**30:.1f} GiB")
        return ", ".join(parts)

    def warm_up(self) -> None:
        """An accelerator compiles and chooses its kernels with the first image; a processor has nothing to prepare."""
        if self._device.type == "cuda":
            grey = np.full((*self.input_size, 3), 128, np.uint8)
            self.find(grey, lambda scores: np.arange(0), ModelTimes())

    def _encode(self, prompt: str, tokenizer: Tokenizer, tokens: int) -> tuple[Any, Any]:
        with self._torch.inference_mode():
            text = tokenizer(prompt, return_tensors="pt", padding="max_length", truncation=True, max_length=tokens)
            ids, mask = text["input_ids"].to(self._device), text["attention_mask"].to(self._device)
            return self._model.get_text_features(input_ids=ids, attention_mask=mask, return_dict=True), mask

    def find(
        self, image_bgr: Image, choose: Callable[[FloatArray], npt.NDArray[np.intp]], times: ModelTimes
    ) -> list[SoftMask]:
        """All answers to all prompts that ``choose`` wants, given the scores (Q,) of one prompt's queries.

        image_bgr: (H, W, 3) uint8. Image features are computed once and shared by the prompts.
        """
        with self._torch.inference_mode():
            began = self._now()
            pixels = self._pixels(image_bgr)
            began = self._lap(times, "resize", began)
            vision = self._model.get_vision_features(pixel_values=pixels)
            began = self._lap(times, "vision", began)
            found: list[SoftMask] = []
            for prompt, text, mask in self._prompts:
                out = self._model(vision_embeds=vision, text_embeds=text, attention_mask=mask)
                logits = out.pred_logits[0].float().sigmoid()
                if out.presence_logits is not None:
                    logits = logits * out.presence_logits.reshape(-1)[0].float().sigmoid()
                scores = np.asarray(logits.cpu().numpy(), dtype=np.float32)
                chosen = choose(scores)
                if len(chosen):
                    soft = out.pred_masks[0][self._torch.as_tensor(chosen, device=self._device)].float().sigmoid()
                    planes = np.asarray(soft.cpu().numpy(), dtype=np.float32)
                    found += [
                        SoftMask(plane, float(scores[k]), prompt) for plane, k in zip(planes, chosen, strict=True)
                    ]
            self._lap(times, "prompts", began)
        return found

    def _pixels(self, image_bgr: Image) -> Any:
        """(1, 3, a, b) in -1..1, RGB."""
        raw = self._torch.from_numpy(np.ascontiguousarray(image_bgr)).to(self._device)
        planes = raw.permute(2, 0, 1).flip(0)[None].float()
        resized = self._torch.nn.functional.interpolate(
            planes, size=self.input_size, mode="bilinear", align_corners=False, antialias=True
        )
        return (resized.round().clamp(0.0, 255.0) / 127.5 - 1.0).to(self._dtype)

    def _now(self) -> int:
        if self._device.type == "cuda":
            self._torch.cuda.synchronize(self._device)
        return perf_counter_ns()

    def _lap(self, times: ModelTimes, stage: str, began_ns: int) -> int:
        now_ns = self._now()
        times.ns[stage] = times.ns.get(stage, 0) + now_ns - began_ns
        return now_ns


def choose_device(params: Sam3Params) -> tuple[Any, Any]:
    """Device and number type of torch. Raises ConfigError for an accelerator that is not there."""
    import torch

    there = torch.cuda.is_available()
    name = ("cuda" if there else "cpu") if params.device == "auto" else params.device
    device = torch.device(name)
    if device.type == "cuda" and (not there or (device.index or 0) >= torch.cuda.device_count()):
        raise ConfigError(
            f"sam3 device {params.device!r}: torch sees {torch.cuda.device_count()} such devices.",
            'Install the driver and a torch with CUDA, or set device = "cpu" (a minute and more per frame).',
        )
    if params.precision != "auto":
        return device, getattr(torch, params.precision)
    if device.type == "cpu":
        return device, torch.float32
    return device, torch.bfloat16 if torch.cuda.is_bf16_supported() else torch.float16


def load_network(params: Sam3Params) -> Sam3Network:
    """Load model and tokenizer from a folder, without the network, or from the hub by name.

    Raises ConfigError when a package, the weights or the device are missing, or the weights are of something else.
    """
    location = check_sam3(params)
    os.environ.setdefault("HF_HUB_DISABLE_PROGRESS_BARS", "1")
    import torch
    import transformers
    from safetensors import SafetensorError

    transformers.logging.set_verbosity_error()
    transformers.logging.disable_progress_bar()
    torch.set_num_threads(params.threads)
    device, dtype = choose_device(params)
    local = location.is_folder
    try:
        config = transformers.AutoConfig.from_pretrained(location.source, local_files_only=local)
        class_name = MODEL_CLASSES.get(config.model_type)
        if class_name is None or not hasattr(transformers, class_name):
            raise ConfigError(
                f"sam3 model {params.model}: is a {config.model_type!r}, not one of {', '.join(MODEL_CLASSES)}.",
                "Give a folder with SAM 3, and transformers of version 5 or later.",
            )
        tokenizer = transformers.AutoTokenizer.from_pretrained(location.source, local_files_only=local)
        model, report = getattr(transformers, class_name).from_pretrained(
            location.source, local_files_only=local, dtype=dtype, output_loading_info=True
        )
    except (OSError, ValueError, ImportError, RuntimeError, SafetensorError) as error:
        what = str(error).strip().splitlines()[0] if str(error).strip() else type(error).__name__
        raise ConfigError(f"sam3 model {params.model}: cannot be loaded: {what}.", HOW_TO_GET_WEIGHTS) from error
    absent = sorted(report["missing_keys"])
    if absent:
        raise ConfigError(
            f"sam3 model {params.model}: {len(absent)} weights are missing ({absent[0]} ...).", HOW_TO_GET_WEIGHTS
        )
    network = Sam3Network(model, tokenizer, params.prompts, device, dtype)
    network.warm_up()
    return network
