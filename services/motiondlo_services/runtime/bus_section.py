"""``[bus]``: where the daemons of a cell listen, and how large messages travel."""

from __future__ import annotations

import os
import re
import stat
from pathlib import Path

from pydantic import BaseModel, ConfigDict, Field, field_validator

from motiondlo.bus.config import BusConfig
from motiondlo.errors import ConfigError
from motiondlo_services.processes import PROCESSES

_FIRST_PORT = 7451
_WITHIN_HOST = r"tcp/(127\.0\.0\.1|localhost|\[::1\]):\d{1,5}|unixsock-stream//[^?#]+"
"""Only the gate listens to anything else."""


def default_endpoints(first_port: int = _FIRST_PORT) -> dict[str, str]:
    """One loopback port a daemon, counting up in the order of the process table."""
    return {name: f"tcp/127.0.0.1:{first_port + k}" for k, name in enumerate(_mesh())}


def _mesh() -> tuple[str, ...]:
    return tuple(row.name for row in PROCESSES if row.in_mesh)


def socket_folder_problem(folder: Path) -> str:
    """Why a folder is not private to this user; empty if it is. A folder that is not there yet is no problem."""
    try:
        status = folder.lstat()
    except FileNotFoundError:
        return ""
    except OSError as error:
        return f"{folder} cannot be looked at ({error.strerror})"
    if not stat.S_ISDIR(status.st_mode):
        return f"{folder} is no folder"
    if status.st_uid != os.geteuid():
        return f"{folder} belongs to another user"
    if status.st_mode & 0o077:
        return f"{folder} is open to others ({stat.S_IMODE(status.st_mode):04o})"
    return ""


class BusSection(BaseModel):
    """The bus as one cell uses it; the same in the configuration of all its daemons."""

    model_config = ConfigDict(frozen=True, extra="forbid", strict=True)

    endpoints: dict[str, str] = Field(
        default_factory=dict, description="endpoint of a daemon by its name; those left out have their default port"
    )
    first_port: int = Field(
        default=_FIRST_PORT, ge=1024, le=65_000, description="default ports count up from here, one per daemon"
    )
    socket_folder: str = Field(
        default="",
        pattern=r"^(/[A-Za-z0-9_.-]+){0,8}$",
        max_length=80,
        description="private folder (mode 0700) for unix sockets instead of ports, /run/motiondlo under systemd; "
        "empty: loopback ports, which every user of this machine can connect to",
    )
    lease_ms: int = Field(default=800, ge=100, le=10_000, description="a silent neighbour is lost after this time")
    shared_memory: bool = Field(default=True, description="large messages through shared memory where it works")
    shared_memory_mib: int = Field(
        default=128, ge=1, le=16_384, description="pool of a process that sends large messages, locked in memory"
    )

    @field_validator("endpoints")
    @classmethod
    def _known_daemons(cls, endpoints: dict[str, str]) -> dict[str, str]:
        unknown = sorted(set(endpoints) - set(_mesh()))
        if unknown:
            raise ValueError(f"the name of a daemon, and {', '.join(unknown)} is none")
        for daemon, endpoint in endpoints.items():
            if re.fullmatch(_WITHIN_HOST, endpoint) is None:
                raise ValueError(f"on loopback (tcp/127.0.0.1:PORT) or a unix socket, and {daemon} is at {endpoint}")
        return endpoints

    def all_endpoints(self) -> dict[str, str]:
        """The endpoint of every daemon that listens, in the order of the process table."""
        if self.socket_folder:
            default = {name: f"unixsock-stream/{self.socket_folder}/{name}.sock" for name in _mesh()}
        else:
            default = default_endpoints(self.first_port)
        return {**default, **self.endpoints}

    def prepare_socket_folder(self) -> None:
        """Make the folder of the sockets, private, if there is to be one and it is not there.

        Raises ConfigError when it cannot be made, or is another user's or open to others.
        """
        if not self.socket_folder:
            return
        folder = Path(self.socket_folder)
        try:
            folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        except OSError as error:
            raise ConfigError(
                f"[bus] socket_folder: {folder} cannot be made ({error.strerror}).", "Choose another folder."
            ) from error
        problem = socket_folder_problem(folder)
        if problem:
            raise ConfigError(f"[bus] socket_folder: {problem}.", f"chmod 0700 {folder}, and start as its owner.")

    def of_daemon(self, cell: str, daemon: str) -> BusConfig:
        """The session of one daemon among its peers."""
        return BusConfig.mesh(
            cell,
            self.all_endpoints(),
            daemon,
            lease_ms=self.lease_ms,
            shared_memory=self.shared_memory,
            shared_memory_mib=self.shared_memory_mib,
        )

    def of_client(self, cell: str, *daemons: str) -> BusConfig:
        """The session of a program beside the cell that talks to ``daemons`` (all of them by default)."""
        endpoints = self.all_endpoints()
        connect = tuple(endpoints[name] for name in (daemons or endpoints))
        return BusConfig(cell=cell, mode="peer", connect=connect, lease_ms=self.lease_ms)
