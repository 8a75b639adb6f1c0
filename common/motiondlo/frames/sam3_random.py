"""SAM 3 with random weights: its speed does not depend on them, and tests need no download."""

from __future__ import annotations

from typing import Any, Literal

from motiondlo.frames.backend_params import Sam3Params
from motiondlo.frames.sam3_model import Sam3Network, choose_device

Size = Literal["full", "tiny"]


def random_network(params: Sam3Params, size: Size, seed: int = 0) -> Sam3Network:
    """The real architecture ("full": 840 M parameters; "tiny": 0.2 M) on the wanted device, with random weights.

    Raises ConfigError for an accelerator that is not there.
    """
    import torch

    torch.set_num_threads(params.threads)
    device, dtype = choose_device(params)
    model = random_model(size, seed, device, dtype)
    return Sam3Network(model, byte_tokenizer(), params.prompts, device, dtype)


def random_model(size: Size, seed: int, device: Any, dtype: Any) -> Any:
    """A Sam3Model made in place on ``device``, so that no second copy is needed anywhere."""
    import torch
    from transformers import Sam3Config, Sam3Model

    torch.manual_seed(seed)
    before = torch.get_default_dtype()
    torch.set_default_dtype(dtype)
    try:
        with torch.device(device):
            return Sam3Model(Sam3Config() if size == "full" else tiny_config())
    finally:
        torch.set_default_dtype(before)


def tiny_config(patches: int = 8, width: int = 32) -> Any:
    """Every part of the architecture, each as small as it can be; images of ``14 * patches`` px."""
    from transformers import CLIPTextConfig, Sam3Config
    from transformers.models.sam3.configuration_sam3 import (
        Sam3DETRDecoderConfig,
        Sam3DETREncoderConfig,
        Sam3GeometryEncoderConfig,
        Sam3MaskDecoderConfig,
        Sam3VisionConfig,
        Sam3ViTConfig,
    )

    small = {"hidden_size": width, "num_attention_heads": 2}
    backbone = Sam3ViTConfig(
        **small,
        intermediate_size=64,
        num_hidden_layers=2,
        image_size=14 * patches,
        patch_size=14,
        window_size=4,
        global_attn_indexes=[1],
        pretrain_image_size=14 * patches,
    )
    vision = Sam3VisionConfig(
        backbone_config=backbone,
        fpn_hidden_size=width,
        backbone_feature_sizes=[[4 * patches] * 2, [2 * patches] * 2, [patches] * 2],
    )
    text = CLIPTextConfig(
        **small,
        vocab_size=514,
        intermediate_size=64,
        num_hidden_layers=1,
        projection_dim=width,
        max_position_embeddings=32,
        bos_token_id=512,
        eos_token_id=513,
        pad_token_id=513,
    )
    return Sam3Config(
        vision_config=vision,
        text_config=text,
        geometry_encoder_config=Sam3GeometryEncoderConfig(**small, num_layers=1, intermediate_size=64),
        detr_encoder_config=Sam3DETREncoderConfig(**small, num_layers=1, intermediate_size=64),
        detr_decoder_config=Sam3DETRDecoderConfig(**small, num_layers=1, intermediate_size=64, num_queries=4),
        mask_decoder_config=Sam3MaskDecoderConfig(**small),
    )


def byte_tokenizer() -> Any:
    """CLIP's tokenizer with a vocabulary of single bytes: no file is needed."""
    from transformers import CLIPTokenizer
    from transformers.convert_slow_tokenizer import bytes_to_unicode

    alphabet = list(bytes_to_unicode().values())
    words = [*alphabet, *(letter + "</w>" for letter in alphabet), "<|startoftext|>", "<|endoftext|>"]
    return CLIPTokenizer(vocab={word: k for k, word in enumerate(words)}, merges=[])
