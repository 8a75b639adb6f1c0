"""Validation errors as a person wants them: the field, the value that it has, the bound that it breaks."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, TypeVar

from pydantic import BaseModel, ValidationError

from motiondlo.errors import ConfigError

Model = TypeVar("Model", bound=BaseModel)


def validated(model: type[Model], values: Mapping[str, Any], where: str) -> Model:
    """``model`` filled from ``values``; ``where`` names their origin (a file and section, or an option).

    Lists become tuples, as TOML and the command line have no tuples. Raises ConfigError that names every wrong field.
    """
    try:
        return model.model_validate(_tuples(values))
    except ValidationError as error:
        raise ConfigError(f"{where}: {describe(error)}", "Correct the value.") from error


def describe(error: ValidationError) -> str:
    """One line for all the errors: ``field = value: what is wrong with it``."""
    parts = []
    for item in error.errors():
        name = ".".join(str(part) for part in item["loc"]) or "(all)"
        if item["type"] == "extra_forbidden":
            parts.append(f"{name}: no such field")
        elif item["type"] == "missing":
            parts.append(f"{name}: is missing")
        else:
            message = item["msg"].removeprefix("Input should be ").removeprefix("Value error, ")
            parts.append(f"{name} = {item['input']!r}: should be {message}")
    return "; ".join(parts) + "."


def _tuples(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {key: _tuples(item) for key, item in value.items()}
    if isinstance(value, list):
        return tuple(_tuples(item) for item in value)
    return value


def parse_assignment(text: str) -> tuple[str, Any]:
    """``key=value`` of ``--set`` into its key and a bool, int, float or string. Raises ConfigError without a ``=``."""
    key, sign, raw = text.partition("=")
    if not sign or not key.strip():
        raise ConfigError(
            f"--set {text!r}: no assignment.", "Write it as key=value, for instance tracker.output_nodes=40."
        )
    return key.strip(), _scalar(raw.strip())


def _scalar(raw: str) -> bool | int | float | str:
    if raw.lower() in ("true", "false"):
        return raw.lower() == "true"
    for kind in (int, float):
        try:
            return kind(raw)
        except ValueError:
            continue
    return raw
