"""What the gate tells zenoh: who is trusted, what passes, how much of it."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from motiondlo.bus.config import BusConfig
from motiondlo.security.access import access_control, largest_message_bytes, rate_limits, size_limits
from motiondlo.security.folder import CertificateFolder
from motiondlo.security.tls import tls_settings
from motiondlo_services.gate.config import CERTIFICATE, GateConfig

_ACCEPT_TIMEOUT_MS = 3000
_ACCEPT_PENDING = 16


def gate_session(
    cell: str, daemon: str, endpoints: Iterable[str], config: GateConfig, folder: CertificateFolder, lease_ms: int
) -> BusConfig:
    """The gate's session: a router that is linked to the cell's daemons and listens over TLS alone.

    endpoints: those of the cell's daemons.
    """
    commands = {"gateway": config.gateway_commands}
    inside = tuple(endpoints)
    settings: dict[str, Any] = {
        **tls_settings(folder, CERTIFICATE, listens=True),
        "access_control": access_control(cell, daemon, config.visitors, commands),
        "low_pass_filter": size_limits(),
        "downsampling": rate_limits(cell, commands),
        "transport/link/rx/max_message_size": largest_message_bytes(),
        "transport/unicast/max_sessions": config.max_visitors + len(inside),
        "transport/unicast/accept_timeout": _ACCEPT_TIMEOUT_MS,
        "transport/unicast/accept_pending": _ACCEPT_PENDING,
        "adminspace/enabled": False,
    }
    return BusConfig(
        cell=cell,
        mode="router",
        listen=(config.listen,),
        connect=inside,
        lease_ms=lease_ms,
        shared_memory=False,
        zenoh=settings,
    )
