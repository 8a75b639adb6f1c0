"""How long work reports how far it is; what shows it is the caller's."""

from __future__ import annotations

from collections.abc import Callable

Progress = Callable[[float], None]
"""Called with the share done, 0..1."""


def no_progress(_share: float) -> None:
    """For callers that do not want to know."""
