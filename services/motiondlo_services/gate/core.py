"""What the gate tells zenoh, and what it keeps an eye on: its certificates and its visitors."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable
from datetime import datetime, timedelta
from typing import Any

from motiondlo.bus.config import BusConfig
from motiondlo.errors import ConfigError
from motiondlo.security.access import access_control, largest_message_bytes, rate_limits, size_limits
from motiondlo.security.folder import CertificateFolder
from motiondlo.security.inspection import Complaint, inspect
from motiondlo.security.tls import tls_settings
from motiondlo_services.gate.config import CERTIFICATE, GateConfig

LOOK_AGAIN = timedelta(minutes=1)
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


def certificate_complaints(config: GateConfig, folder: CertificateFolder, now: datetime) -> list[Complaint]:
    """What is wrong with the gate's own pair and the authority."""
    return inspect(folder, [CERTIFICATE], now, config.warn_days)


def check_certificates(config: GateConfig, folder: CertificateFolder, now: datetime) -> None:
    """Raises ConfigError when the gate could not work, or would not be safe, with its certificates."""
    serious = [entry for entry in certificate_complaints(config, folder, now) if entry.serious]
    if serious:
        first = serious[0]
        raise ConfigError(f"[gate] certificates: {first.name}: {first.what}.", first.what_to_do)


class GateCore:
    """Certificates and visitors, for health."""

    def __init__(self, config: GateConfig, folder: CertificateFolder) -> None:
        self._config, self._folder = config, folder
        self._here: Counter[str] = Counter()
        self._look_at: datetime | None = None
        self._in_use: bytes | None = None
        self.problems: tuple[str, ...] = ()
        self.counts: Counter[str] = Counter()
        """``arrivals`` and ``departures`` of visitors."""

    def look(self, now: datetime) -> bool:
        """Look at the certificates if it is time to; whether the problems have changed."""
        if self._look_at is not None and now < self._look_at:
            return False
        self._look_at = now + LOOK_AGAIN
        before = self.problems
        complaints = certificate_complaints(self._config, self._folder, now)
        problems = [f"certificate {entry.name}: {entry.what}" for entry in complaints]
        on_disk = self._certificate()
        if self._in_use is None:
            self._in_use = on_disk
        elif on_disk and on_disk != self._in_use:
            problems.append("the gate's certificate was renewed: restart the gate to use it")
        self.problems = tuple(problems)
        return self.problems != before

    def see(self, visitors: Iterable[str]) -> bool:
        """Take note of who is connected; whether anyone came or went."""
        here = Counter(visitors)
        self.counts["arrivals"] += (here - self._here).total()
        self.counts["departures"] += (self._here - here).total()
        changed = here != self._here
        self._here = here
        return changed

    def info(self) -> dict[str, int | str]:
        """Who is there, for health."""
        return {"visitors": self._here.total(), "visitor_names": ", ".join(sorted(self._here))[:1000]}

    def _certificate(self) -> bytes:
        try:
            return self._folder.certificate(CERTIFICATE).read_bytes()
        except OSError:
            return b""
