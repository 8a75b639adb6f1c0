"""The roles that a certificate can give, and what each may do: one row a role.

The role is the first part of a certificate's common name ("monitor", "monitor.hall-screen"), which the cell's authority
has signed. Whoever holds a certificate can therefore never choose another role.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Any, Final

from motiondlo.errors import MotionDLOError
from motiondlo.messages.command import Verb
from motiondlo.topics import HEALTH, STATE, Topic

COMMON_NAME_PATTERN: Final = r"^[a-z]+(\.[a-z0-9][a-z0-9-]{0,31})?$"


@dataclass(frozen=True)
class Role:
    """One row."""

    name: str
    purpose: str
    listens: bool
    """Its certificate may open a server; all others are for clients only."""
    reads: tuple[Topic[Any], ...]
    commands: tuple[Verb, ...]
    """What it may ask for unless the configuration of the gate says otherwise."""


ROLES: Final[tuple[Role, ...]] = (
    Role("daemon", "the gate itself", listens=True, reads=(), commands=()),
    Role(
        "gateway",
        "a PLC's or a robot's side: reads, and gives commands",
        listens=False,
        reads=(STATE, HEALTH),
        commands=("segment", "reset", "pause", "resume"),
    ),
    Role("monitor", "a screen: reads and nothing else", listens=False, reads=(STATE, HEALTH), commands=()),
)


def role_named(name: str) -> Role:
    """The row called ``name``. Raises MotionDLOError if there is none."""
    for role in ROLES:
        if role.name == name:
            return role
    raise MotionDLOError(f"There is no role {name!r}.", f"Roles: {', '.join(role.name for role in ROLES)}.")


def role_of(common_name: str) -> Role:
    """The role that a certificate's common name gives. Raises MotionDLOError for a name that gives none."""
    if re.fullmatch(COMMON_NAME_PATTERN, common_name) is None:
        raise MotionDLOError(
            f"{common_name!r} is no name of a certificate.",
            "Write a role, or a role, a dot, and small letters, digits and '-', as in monitor.hall-screen.",
        )
    return role_named(common_name.partition(".")[0])


def common_name(role: Role, name: str = "") -> str:
    """The common name of the holder ``name`` in ``role``. Raises MotionDLOError."""
    full = f"{role.name}.{name}" if name else role.name
    role_of(full)
    return full
