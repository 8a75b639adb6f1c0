"""Errors that reach a person: one line that says what is wrong, one that says what to do about it."""

from __future__ import annotations


class MotionDLOError(Exception):
    """A failure with its remedy; the command line prints both and exits with code 1 (no traceback)."""

    def __init__(self, what: str, what_to_do: str = "") -> None:
        super().__init__(what)
        self.what = what
        self.what_to_do = what_to_do

    def __str__(self) -> str:
        return f"{self.what} {self.what_to_do}".strip()


class ConfigError(MotionDLOError):
    """A configuration file or an option is wrong: names the file, the field, the value and the bound."""


class RecordingError(MotionDLOError):
    """A recording lacks something that the wanted mode needs, or a file in it cannot be used at all."""


class CalibrationError(MotionDLOError):
    """A homography or calibration file is absent, singular or has the wrong shape."""
