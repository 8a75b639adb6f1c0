"""TLS at both ends of the gate: who is trusted, and what oneself shows."""

from __future__ import annotations

from typing import Any

from motiondlo.bus.config import BusConfig
from motiondlo.security.folder import AUTHORITY, CertificateFolder


def tls_settings(folder: CertificateFolder, name: str, listens: bool) -> dict[str, Any]:
    """zenoh's settings for the holder ``name``; both ends always show a certificate of the cell's authority."""
    side = "listen" if listens else "connect"
    return {
        "transport/link/tls/root_ca_certificate": str(folder.certificate(AUTHORITY).resolve()),
        f"transport/link/tls/{side}_certificate": str(folder.certificate(name).resolve()),
        f"transport/link/tls/{side}_private_key": str(folder.key(name).resolve()),
        "transport/link/tls/enable_mtls": True,
        "transport/link/tls/verify_name_on_connect": True,
        "transport/link/tls/close_link_on_expiration": True,
    }


def remote_client(cell: str, endpoint: str, folder: CertificateFolder, name: str, **settings: Any) -> BusConfig:
    """A session from another machine through the gate at ``endpoint``, for instance ``tls/cell-pc.local:7447``.

    folder: holds authority.crt, and the certificate and key of the holder ``name``. ``settings`` as of BusConfig.
    """
    defaults = {"same_host": False, "shared_memory": False}
    return BusConfig(
        cell=cell,
        mode="client",
        connect=(endpoint,),
        zenoh=tls_settings(folder, name, listens=False),
        **(defaults | settings),
    )
