"""``[bus]``: where the daemons of a cell listen, and how large messages travel."""

from __future__ import annotations

from pydantic import BaseModel, ConfigDict, Field, field_validator

from motiondlo.bus.config import BusConfig
from motiondlo_services.processes import PROCESSES

_FIRST_PORT = 7451


def default_endpoints(first_port: int = _FIRST_PORT) -> dict[str, str]:
    """One loopback port a daemon, counting up in the order of the process table."""
    return {row.name: f"tcp/127.0.0.1:{first_port + k}" for k, row in enumerate(PROCESSES)}


class BusSection(BaseModel):
    """The bus as one cell uses it; the same in the configuration of all its daemons."""

    model_config = ConfigDict(frozen=True, extra="forbid", strict=True)

    endpoints: dict[str, str] = Field(
        default_factory=dict, description="endpoint of a daemon by its name; those left out have their default port"
    )
    first_port: int = Field(
        default=_FIRST_PORT, ge=1024, le=65_000, description="default ports count up from here, one per daemon"
    )
    lease_ms: int = Field(default=800, ge=100, le=10_000, description="a silent neighbour is lost after this time")
    shared_memory: bool = Field(default=True, description="large messages through shared memory where it works")
    shared_memory_mib: int = Field(
        default=128, ge=1, le=16_384, description="pool of a process that sends large messages, locked in memory"
    )

    @field_validator("endpoints")
    @classmethod
    def _known_daemons(cls, endpoints: dict[str, str]) -> dict[str, str]:
        unknown = sorted(set(endpoints) - {row.name for row in PROCESSES})
        if unknown:
            raise ValueError(f"the name of a daemon, and {', '.join(unknown)} is none")
        return endpoints

    def all_endpoints(self) -> dict[str, str]:
        """Every daemon's endpoint, in the order of the process table."""
        return {**default_endpoints(self.first_port), **self.endpoints}

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
