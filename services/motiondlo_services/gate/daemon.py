"""The gate's shell: zenoh itself passes on what access control allows; this only watches and reports."""

from __future__ import annotations

import sys
import time
from datetime import UTC, datetime

from motiondlo.bus.config import BusConfig
from motiondlo.bus.session import Bus
from motiondlo.security.folder import CertificateFolder
from motiondlo_services.gate.config import GateConfig
from motiondlo_services.gate.core import GateCore, check_certificates, gate_session
from motiondlo_services.runtime.bus_section import BusSection
from motiondlo_services.runtime.shell import Shell, run_daemon

PERIOD_S = 0.25


def session(shell: Shell, section: BusSection) -> BusConfig | None:
    """The gate's session; None where the cell has no gate. Raises ConfigError for certificates that cannot be used."""
    config, folder = _settings(shell)
    if not config.enabled:
        return None
    check_certificates(config, folder, datetime.now(UTC))
    endpoints = section.all_endpoints().values()
    return gate_session(shell.cell.cell.name, shell.row.name, endpoints, config, folder, section.lease_ms)


def serve(shell: Shell, bus: Bus) -> None:
    """Watch until told to stop."""
    core = GateCore(*_settings(shell))
    shell.ready()
    while shell.running:
        changed = core.look(datetime.now(UTC)) | core.see(bus.visitors())
        shell.problems = core.problems
        shell.take_over(core.counts)
        shell.tick(core.info(), {}, now=changed)
        time.sleep(PERIOD_S)


def _settings(shell: Shell) -> tuple[GateConfig, CertificateFolder]:
    config = shell.section(GateConfig)
    return config, CertificateFolder(shell.cell.resolve(config.certificates))


def main() -> int:
    """Entry point of ``motiondlo-gate``."""
    return run_daemon("gate", serve, session)


if __name__ == "__main__":
    sys.exit(main())
