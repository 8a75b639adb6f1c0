"""``[gate]``: where the gate listens, who may come in, and what they may ask for."""

from __future__ import annotations

from pydantic import BaseModel, ConfigDict, Field, field_validator

from motiondlo.errors import MotionDLOError
from motiondlo.messages.command import Verb
from motiondlo.security.roles import role_named, role_of

CERTIFICATE = "daemon"
"""The gate's own certificate."""


class GateConfig(BaseModel):
    """The gate's section."""

    model_config = ConfigDict(frozen=True, extra="forbid", strict=True)

    enabled: bool = Field(default=False, description="let others in from outside; needs certificates (motiondlo certs)")
    listen: str = Field(
        default="tls/0.0.0.0:7447",
        pattern=r"^tls/(\[[0-9a-fA-F:]+\]|[A-Za-z0-9.-]+):[0-9]{1,5}$",
        description="address and port towards the outside; only TLS",
    )
    certificates: str = Field(
        default="certs",
        min_length=1,
        description="folder with authority.crt, daemon.crt and daemon.key; authority.key need not be there",
    )
    visitors: tuple[str, ...] = Field(
        default=("gateway", "monitor"),
        max_length=64,
        description="names in the certificates that are let in (monitor, monitor.hall-screen, gateway.plc1 ...); "
        "a name that is taken off is locked out when the gate restarts",
    )
    gateway_commands: tuple[Verb, ...] = Field(
        default=role_named("gateway").commands, description="commands that gateways may give; monitors give none"
    )
    max_visitors: int = Field(default=16, ge=1, le=256, description="so many may be connected at the same time")
    warn_days: int = Field(
        default=30, ge=1, le=365, description="health and doctor warn so long before a certificate expires"
    )

    @field_validator("visitors")
    @classmethod
    def _names_with_a_role(cls, names: tuple[str, ...]) -> tuple[str, ...]:
        for name in names:
            try:
                role = role_of(name)
            except MotionDLOError as error:
                raise ValueError(f"names of certificates: {error}") from None
            if role.listens:
                raise ValueError(f"names of visitors, and {name} is the gate itself")
        return names
