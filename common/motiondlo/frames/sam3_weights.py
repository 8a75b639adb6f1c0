"""Where SAM 3's weights are, whether they are complete, and how a person gets them. Imports no torch."""

from __future__ import annotations

import importlib.util
from dataclasses import dataclass
from importlib import metadata
from pathlib import Path

from motiondlo.errors import ConfigError
from motiondlo.frames.backend_params import Sam3Params

HOW_TO_INSTALL = "Install them: pip install 'motiondlo[sam3]'."
HOW_TO_GET_WEIGHTS = (
    "Ask for access at https://huggingface.co/facebook/sam3, then: hf auth login; "
    'hf download facebook/sam3 --local-dir DIR; and set [segmenter.sam3] model = "DIR".'
)
_PACKAGES = ("torch", "transformers", "safetensors")
_TOKENIZERS = (("tokenizer.json",), ("vocab.json", "merges.txt"))
MODEL_CLASSES = {
    "sam3": "Sam3Model",
    "sam3_video": "Sam3Model",
    "sam3_lite_text": "Sam3LiteTextModel",
}
"""``model_type`` of config.json -> class of transformers that finds things in one image."""


@dataclass(frozen=True)
class WeightsLocation:
    """A folder, or a name on the hub."""

    source: str
    is_folder: bool


def missing_packages() -> tuple[str, ...]:
    """Names of the packages that the backend needs and that are not installed."""
    return tuple(name for name in _PACKAGES if importlib.util.find_spec(name) is None)


def package_versions() -> dict[str, str]:
    """Versions of the packages that are installed."""
    return {name: metadata.version(name) for name in _PACKAGES if importlib.util.find_spec(name) is not None}


def check_sam3(params: Sam3Params) -> WeightsLocation:
    """Packages and weights. Raises ConfigError for what is missing; a hub name is taken as it is."""
    missing = missing_packages()
    if missing:
        raise ConfigError(f"backend sam3 needs {', '.join(missing)}.", HOW_TO_INSTALL)
    return locate(params.model)


def locate(model: str) -> WeightsLocation:
    """Tell a folder from a hub name.

    Raises ConfigError for a folder that lacks a file, and for what is neither an existing folder nor ORG/NAME.
    """
    folder = Path(model).expanduser()
    if folder.is_dir():
        _check_folder(folder)
        return WeightsLocation(str(folder), True)
    if folder.is_absolute() or model.startswith((".", "~")) or model.count("/") != 1:
        raise ConfigError(f"sam3 model {model!r}: no such folder.", HOW_TO_GET_WEIGHTS)
    return WeightsLocation(model, False)


def in_hub_cache(name: str) -> bool:
    """Whether the hub's cache on this machine has the model's configuration and weights."""
    if importlib.util.find_spec("huggingface_hub") is None:
        return False
    from huggingface_hub import try_to_load_from_cache

    files = ("config.json", "model.safetensors")
    return all(isinstance(try_to_load_from_cache(name, file), str) for file in files)


def _check_folder(folder: Path) -> None:
    if not (folder / "config.json").is_file():
        raise ConfigError(f"sam3 model {folder}: has no config.json.", HOW_TO_GET_WEIGHTS)
    weights = [path for path in folder.glob("*.safetensors") if path.stat().st_size > 0]
    if not weights:
        raise ConfigError(f"sam3 model {folder}: has no *.safetensors.", HOW_TO_GET_WEIGHTS)
    if not any(all((folder / name).is_file() for name in names) for names in _TOKENIZERS):
        raise ConfigError(f"sam3 model {folder}: has no tokenizer.json.", HOW_TO_GET_WEIGHTS)
