"""How a program joins a cell's bus: explicit endpoints, no scouting."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any, Literal, Self

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, JsonValue

from motiondlo.errors import ConfigError
from motiondlo.messages.header import NAME_PATTERN


def _tuple(value: object) -> object:
    return tuple(value) if isinstance(value, list) else value


Endpoint = Annotated[str, Field(pattern=r"^[a-z0-9-]+/.+$")]
Endpoints = Annotated[tuple[Endpoint, ...], BeforeValidator(_tuple)]


class BusConfig(BaseModel):
    """One session.

    The default is a mesh of direct peers: each daemon listens on its own endpoint and connects to those of the others.

    Considered and rejected: clients around one router. Three hops (ingest, tracker, fusion, subscriber) of 1 KiB at
    500 Hz over TCP loopback took 530-650 us p50 through a router against 310-450 us between peers (unix sockets:
    390-430 us), and the death of the router would stop the whole cell, where a dead peer stops only itself. Gossip or
    multicast to find the peers: anything on the network could join.
    """

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True)

    cell: Annotated[str, Field(pattern=NAME_PATTERN, description="Name of the cell; part of every key.")]
    mode: Annotated[
        Literal["peer", "client", "router"],
        Field(description="peer: a daemon of the cell; client: a program beside it; router: the gate to the outside."),
    ] = "peer"
    listen: Annotated[Endpoints, Field(description="Own endpoints, e.g. tcp/127.0.0.1:7451.")] = ()
    connect: Annotated[Endpoints, Field(description="Endpoints of others; they may start later.")] = ()
    lease_ms: Annotated[
        int, Field(ge=100, le=10_000, description="A silent neighbour counts as lost after this time.")
    ] = 800
    open_timeout_s: Annotated[
        float, Field(ge=0.0, le=600.0, description="How long a client waits for its endpoint at start.")
    ] = 10.0
    same_host: Annotated[
        bool, Field(description="All senders share this host's monotonic clock; false for a monitor elsewhere.")
    ] = True
    shared_memory: Annotated[bool, Field(description="Large messages through shared memory where it works.")] = True
    shared_memory_mib: Annotated[
        int, Field(ge=1, le=16_384, description="Pool of a process that sends large messages, locked in memory.")
    ] = 128
    zenoh: Annotated[
        dict[str, JsonValue], Field(description="Further zenoh settings by path (TLS, users, access control).")
    ] = {}

    @classmethod
    def mesh(cls, cell: str, endpoints: Mapping[str, str], daemon: str, **settings: Any) -> Self:
        """The session of ``daemon`` among direct peers.

        ``endpoints``: every daemon's own endpoint, in the same order for all. Each connects to those before it and is
        found by those after it, so that each pair has one link, whichever of the two starts or restarts last.

        Raises ConfigError if ``daemon`` has no endpoint.
        """
        if daemon not in endpoints:
            raise ConfigError(f"{daemon} has no endpoint.", f"Endpoints are given for: {', '.join(endpoints)}.")
        names = list(endpoints)
        earlier = tuple(endpoints[name] for name in names[: names.index(daemon)])
        return cls(cell=cell, mode="peer", listen=(endpoints[daemon],), connect=earlier, **settings)
