"""Failures of the bus that reach a person."""

from __future__ import annotations

from motiondlo.errors import MotionDLOError


class BusError(MotionDLOError):
    """A session cannot be opened or is closed."""


class CommandError(MotionDLOError):
    """A command was not answered, or answered with an error."""
