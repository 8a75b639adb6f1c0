"""Read a cell's TOML file, one section or all of it; a wrong value names the file, the field, the value, the bound."""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Any, TypeVar

from pydantic import BaseModel

from motiondlo.config.validation import validated
from motiondlo.errors import ConfigError

Model = TypeVar("Model", bound=BaseModel)

_MAX_BYTES = 4 << 20


def read_toml(path: Path) -> dict[str, Any]:
    """The file's tables. Raises ConfigError when it is missing or no TOML."""
    try:
        with path.open("rb") as file:
            data = file.read(_MAX_BYTES + 1)
    except OSError as error:
        raise ConfigError(f"{path}: {error.strerror or error}.", "Give a configuration file that exists.") from error
    if len(data) > _MAX_BYTES:
        raise ConfigError(f"{path}: more than {_MAX_BYTES >> 20} MiB.", "Give the configuration of a cell.")
    try:
        return tomllib.loads(data.decode("utf-8"))
    # ValueError covers its own errors and what its conversions raise; nesting without end is a RecursionError.
    except (ValueError, RecursionError) as error:
        raise ConfigError(f"{path}: not valid TOML ({error}).", "Correct the file.") from error


def load_section(path: Path, section: str, model: type[Model]) -> Model:
    """One section of the file as ``model``; a section that is absent has its defaults.

    Raises ConfigError when the file cannot be read, the section is no table, or a value in it is wrong.
    """
    table = read_toml(path).get(section, {})
    if not isinstance(table, dict):
        raise ConfigError(f"{path}: {section} is no table.", f"Write it as [{section}].")
    return validated(model, table, f"{path}: [{section}]")
