"""One finding of the doctor."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from enum import StrEnum


class Verdict(StrEnum):
    """How bad it is."""

    OK = "ok"
    WARNING = "warning"
    """It works, but not as well as it could."""
    FAILURE = "failure"
    """It does not work."""


@dataclass(frozen=True)
class Finding:
    """What was looked at, how it is, and what to do about it (empty when it is fine)."""

    subject: str
    verdict: Verdict
    what: str
    what_to_do: str = ""

    def as_dict(self) -> dict[str, str]:
        """For JSON."""
        return {key: str(value) for key, value in asdict(self).items()}


def ok(subject: str, what: str) -> Finding:
    """All is well."""
    return Finding(subject, Verdict.OK, what)


def warning(subject: str, what: str, what_to_do: str) -> Finding:
    """It works, but."""
    return Finding(subject, Verdict.WARNING, what, what_to_do)


def failure(subject: str, what: str, what_to_do: str) -> Finding:
    """It does not work."""
    return Finding(subject, Verdict.FAILURE, what, what_to_do)
