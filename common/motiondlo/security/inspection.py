"""What is wrong with a folder of certificates: presence, permissions, time, chain, holder. Changes nothing."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from datetime import datetime, timedelta
from pathlib import Path

from cryptography import x509
from cryptography.exceptions import InvalidSignature, UnsupportedAlgorithm
from cryptography.hazmat.primitives.serialization import load_pem_private_key
from cryptography.x509.oid import ExtendedKeyUsageOID

from motiondlo.errors import MotionDLOError
from motiondlo.security.authority import cell_of, common_name_of, hosts_of
from motiondlo.security.folder import AUTHORITY, CertificateFolder, read_pem
from motiondlo.security.roles import role_of

WARN_DAYS = 30
_OTHERS = 0o077
_NO_CERTIFICATE = (
    ValueError,
    TypeError,
    UnsupportedAlgorithm,
    x509.DuplicateExtension,
    x509.InvalidVersion,
    x509.UnsupportedGeneralNameType,
)


@dataclass(frozen=True)
class Complaint:
    """One thing that is wrong, and what to do about it."""

    name: str
    serious: bool
    """It does not work, or is not safe; otherwise it will soon be so."""
    what: str
    what_to_do: str


@dataclass(frozen=True)
class Certificate:
    """What a certificate says."""

    name: str
    cell: str
    hosts: tuple[str, ...]
    from_utc: datetime
    until_utc: datetime
    serial: str

    def days_left(self, now: datetime) -> float:
        """Negative once it has expired."""
        return (self.until_utc - now) / timedelta(days=1)


def load_certificate(path: Path) -> x509.Certificate:
    """Raises MotionDLOError when the file holds none."""
    data = read_pem(path)
    try:
        certificate = x509.load_pem_x509_certificate(data)
        # Parts are parsed when they are first read: here, so that later nothing can go wrong.
        _ = (certificate.extensions, common_name_of(certificate), hosts_of(certificate), certificate.public_key())
        _ = (certificate.not_valid_before_utc, certificate.not_valid_after_utc, certificate.serial_number)
    except _NO_CERTIFICATE as error:
        raise MotionDLOError(f"{path}: no certificate ({error}).", "Make it anew with motiondlo certs.") from error
    return certificate


def describe(path: Path) -> Certificate:
    """What the certificate in a file says. Raises MotionDLOError when there is none."""
    certificate = load_certificate(path)
    return Certificate(
        name=common_name_of(certificate),
        cell=cell_of(certificate),
        hosts=hosts_of(certificate),
        from_utc=certificate.not_valid_before_utc,
        until_utc=certificate.not_valid_after_utc,
        serial=f"{certificate.serial_number:x}",
    )


def inspect(
    folder: CertificateFolder, names: Iterable[str], now: datetime, warn_days: float = WARN_DAYS
) -> list[Complaint]:
    """Everything that is wrong with the authority's certificate and with the pairs of ``names``."""
    if not folder.path.is_dir():
        return [Complaint("folder", True, f"{folder.path} is not there", "Run motiondlo certs init.")]
    found = list(_open_to_others(folder.path, "folder", "0700"))
    try:
        authority = load_certificate(folder.certificate(AUTHORITY))
    except MotionDLOError as error:
        return [*found, Complaint(AUTHORITY, True, error.what, "Run motiondlo certs init.")]
    found += _times(AUTHORITY, authority, now, warn_days)
    if not _signed_by(authority, authority):
        found.append(Complaint(AUTHORITY, True, "is no authority", "Run motiondlo certs init in another folder."))
    if folder.key(AUTHORITY).exists():
        found += _open_to_others(folder.key(AUTHORITY), AUTHORITY, "0600")
    for name in names:
        found += _pair(folder, name, authority, now, warn_days)
    return found


def _pair(
    folder: CertificateFolder, name: str, authority: x509.Certificate, now: datetime, warn_days: float
) -> Iterator[Complaint]:
    again = f"Make it anew: motiondlo certs renew {name}."
    try:
        role = role_of(name)
        certificate = load_certificate(folder.certificate(name))
        key_pem = read_pem(folder.key(name))
    except MotionDLOError as error:
        yield Complaint(name, True, error.what, error.what_to_do)
        return
    yield from _open_to_others(folder.key(name), name, "0600")
    yield from _times(name, certificate, now, warn_days)
    if not _signed_by(certificate, authority):
        yield Complaint(name, True, "is not signed by this authority", again)
    if common_name_of(certificate) != name:
        yield Complaint(name, True, f"belongs to {common_name_of(certificate)!r}", again)
    wanted = ExtendedKeyUsageOID.SERVER_AUTH if role.listens else ExtendedKeyUsageOID.CLIENT_AUTH
    try:
        uses = list(certificate.extensions.get_extension_for_class(x509.ExtendedKeyUsage).value)
    except x509.ExtensionNotFound:
        uses = []
    if uses != [wanted]:
        yield Complaint(name, True, "is made for another use than its role's", again)
    try:
        fits = load_pem_private_key(key_pem, None).public_key() == certificate.public_key()
    except (ValueError, TypeError, UnsupportedAlgorithm):
        fits = False
    if not fits:
        yield Complaint(name, True, "its key is unreadable or another one's", again)


def _open_to_others(path: Path, name: str, mode: str) -> Iterator[Complaint]:
    found = path.stat().st_mode & 0o777
    if found & _OTHERS:
        yield Complaint(name, True, f"{path} is open to others ({found:04o})", f"chmod {mode} {path}")


def _times(name: str, certificate: x509.Certificate, now: datetime, warn_days: float) -> Iterator[Complaint]:
    again = "Make a new authority and new certificates." if name == AUTHORITY else f"motiondlo certs renew {name}"
    left = certificate.not_valid_after_utc - now
    if certificate.not_valid_before_utc > now:
        yield Complaint(name, True, f"holds only from {certificate.not_valid_before_utc:%Y-%m-%d %H:%M} UTC on", again)
    elif left <= timedelta(0):
        yield Complaint(name, True, f"expired on {certificate.not_valid_after_utc:%Y-%m-%d}", again)
    elif left < timedelta(days=warn_days):
        yield Complaint(name, False, f"expires in {left / timedelta(days=1):.0f} days", again)


def _signed_by(certificate: x509.Certificate, authority: x509.Certificate) -> bool:
    try:
        certificate.verify_directly_issued_by(authority)
        return authority.extensions.get_extension_for_class(x509.BasicConstraints).value.ca
    except (ValueError, TypeError, InvalidSignature, x509.ExtensionNotFound):
        return False
