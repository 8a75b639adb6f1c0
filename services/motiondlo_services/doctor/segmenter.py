"""The segmenter's backend: packages, model files, device, and whether they fit together."""

from __future__ import annotations

import importlib.util
from importlib import metadata
from pathlib import Path

from motiondlo.config.cell import Cell
from motiondlo.config.loader import load_section
from motiondlo.errors import ConfigError, MotionDLOError
from motiondlo.frames.backend import create_backend
from motiondlo.frames.backend_params import Sam3Params
from motiondlo.frames.onnx_backend import HOW_TO_INSTALL as HOW_TO_INSTALL_ONNX
from motiondlo.frames.onnx_backend import check_onnx
from motiondlo.frames.sam3_weights import (
    HOW_TO_GET_WEIGHTS,
    HOW_TO_INSTALL,
    in_hub_cache,
    locate,
    missing_packages,
    package_versions,
)
from motiondlo_services.doctor.findings import Finding, failure, ok, warning
from motiondlo_services.segmenter.config import SegmenterConfig

_CPU_IS_SLOW = "cpu: a frame takes a minute and more"


def check_segmenter(cell: Cell) -> list[Finding]:
    """Every finding about the configured backend. SAM 3's weights are looked for, not loaded."""
    try:
        config = load_section(cell.path, "segmenter", SegmenterConfig).resolved(cell.path.parent)
    except MotionDLOError as error:
        return [failure("segmenter", error.what, error.what_to_do)]
    if config.backend == "sam3":
        return _sam3(config.sam3)
    if config.backend == "onnx":
        return _onnx(config)
    try:
        backend = create_backend(config)
    except MotionDLOError as error:
        return [failure("segmenter", error.what, error.what_to_do)]
    return [ok("segmenter", f"backend {backend.name}")]


def _sam3(params: Sam3Params) -> list[Finding]:
    missing = missing_packages()
    if missing:
        packages = failure("segmenter packages", f"backend sam3 needs {', '.join(missing)}", HOW_TO_INSTALL)
        return [packages, _sam3_weights(params)]
    versions = package_versions()
    found = ", ".join(f"{name} {version}" for name, version in versions.items())
    if int(versions["transformers"].split(".")[0]) < 5:
        packages = failure("segmenter packages", f"{found}: SAM 3 came with transformers 5", HOW_TO_INSTALL)
        return [packages, _sam3_weights(params)]
    return [ok("segmenter packages", found), _sam3_weights(params), _sam3_device(params)]


def _sam3_weights(params: Sam3Params) -> Finding:
    try:
        location = locate(params.model)
    except ConfigError as error:
        return failure("segmenter weights", error.what, error.what_to_do)
    if location.is_folder:
        size_mib = sum(path.stat().st_size for path in Path(location.source).glob("*.safetensors")) >> 20
        return ok("segmenter weights", f"{location.source}: {size_mib} MiB")
    if in_hub_cache(location.source):
        return ok("segmenter weights", f"{location.source}: in the hub's cache on this machine")
    return failure("segmenter weights", f"{location.source} is not on this machine", HOW_TO_GET_WEIGHTS)


def _sam3_device(params: Sam3Params) -> Finding:
    from motiondlo.frames.sam3_model import choose_device

    try:
        device, dtype = choose_device(params)
    except ConfigError as error:
        return failure("segmenter device", error.what, error.what_to_do)
    precision = str(dtype).removeprefix("torch.")
    if device.type != "cpu":
        return ok("segmenter device", f"{device}, {precision}")
    return warning(
        "segmenter device",
        f"{_CPU_IS_SLOW} ({precision})",
        'Use a machine with CUDA, raise time_limit_s, or set backend = "classical".',
    )


def _onnx(config: SegmenterConfig) -> list[Finding]:
    if importlib.util.find_spec("onnxruntime") is None:
        return [failure("segmenter packages", "backend onnx needs onnxruntime", HOW_TO_INSTALL_ONNX)]
    findings = [ok("segmenter packages", f"onnxruntime {metadata.version('onnxruntime')}")]
    try:
        check_onnx(config.onnx)
    except ConfigError as error:
        return [*findings, failure("segmenter weights", error.what, error.what_to_do)]
    findings.append(ok("segmenter weights", f"{config.onnx.model}: {Path(config.onnx.model).stat().st_size >> 10} KiB"))
    try:
        create_backend(config)
    except MotionDLOError as error:
        return [*findings, failure("segmenter", error.what, error.what_to_do)]
    return [*findings, ok("segmenter", f"backend onnx on {config.onnx.provider}: inputs and outputs fit")]
