"""Who could get in: the cell's own sockets, shared memory, and the gate with its certificates."""

from __future__ import annotations

import os
import socket
import stat
from contextlib import suppress
from datetime import UTC, datetime
from pathlib import Path

from motiondlo.config.cell import Cell
from motiondlo.config.loader import load_section
from motiondlo.errors import MotionDLOError
from motiondlo.security.folder import AUTHORITY, CertificateFolder
from motiondlo.security.inspection import describe
from motiondlo_services.doctor.findings import Finding, failure, ok, warning
from motiondlo_services.gate.config import CERTIFICATE, GateConfig
from motiondlo_services.gate.core import certificate_complaints
from motiondlo_services.runtime.bus_section import BusSection, socket_folder_problem

SHARED_MEMORY = Path("/dev/shm")


def check_security(cell: Cell, section: BusSection, shared_memory: Path = SHARED_MEMORY) -> list[Finding]:
    """Every finding about who could get in. ``shared_memory``: where zenoh's segments lie."""
    return [_sockets(section), _segments(shared_memory), *_gate(cell)]


def _sockets(section: BusSection) -> Finding:
    if not section.socket_folder:
        return ok("sockets", "loopback ports: other users of this machine could connect ([bus] socket_folder)")
    problem = socket_folder_problem(Path(section.socket_folder))
    if problem:
        return failure("sockets", problem, "chmod 0700, chown to the daemons' user; systemd does it by itself.")
    return ok("sockets", f"unix sockets in {section.socket_folder}, for their owner alone")


def _segments(folder: Path) -> Finding:
    found = []
    for path in folder.glob("*.zenoh"):
        with suppress(OSError):  # gone meanwhile
            status = path.stat()
            if status.st_uid == os.geteuid() and stat.S_IMODE(status.st_mode) & 0o077:
                found.append(path.name)
    if found:
        return failure(
            "shared memory access", f"open to others: {', '.join(sorted(found)[:5])}", f"Remove them from {folder}."
        )
    return ok("shared memory access", "for its owner alone")


def _gate(cell: Cell) -> list[Finding]:
    config = load_section(cell.path, "gate", GateConfig)
    if not config.enabled:
        return [ok("gate", "none: nothing listens beyond this host")]
    folder = CertificateFolder(cell.resolve(config.certificates))
    findings = []
    for entry in certificate_complaints(config, folder, datetime.now(UTC)):
        grade = failure if entry.serious else warning
        findings.append(grade("certificates", f"{entry.name}: {entry.what}", entry.what_to_do))
    with suppress(MotionDLOError):  # missing and unreadable ones are among the complaints
        for name in (AUTHORITY, CERTIFICATE):
            of = describe(folder.certificate(name)).cell
            if of != cell.cell.name:
                findings.append(
                    failure(
                        "certificates",
                        f"{name}: made for the cell {of!r}, this one is {cell.cell.name!r}",
                        "Make certificates for this cell: motiondlo certs init.",
                    )
                )
    findings = findings or [ok("certificates", f"{folder.path}: private, valid, one chain")]
    findings.append(_gate_port(config))
    if not config.visitors:
        findings.append(warning("gate", "lets nobody in", "Name the visitors' certificates in [gate] visitors."))
    return findings


def _gate_port(config: GateConfig) -> Finding:
    host, _, port = config.listen.removeprefix("tls/").rpartition(":")
    family = socket.AF_INET6 if host.startswith("[") else socket.AF_INET
    with socket.socket(family, socket.SOCK_STREAM) as probe:
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            probe.bind((host.strip("[]"), int(port)))
        except (OSError, OverflowError) as error:
            reason = getattr(error, "strerror", None) or error
            return warning(
                "gate", f"cannot listen on {config.listen} ({reason})", "Fine if the cell is running; else change it."
            )
    return ok("gate", f"{config.listen}, for {', '.join(config.visitors) or 'nobody'}")
