"""The cell's own certificate authority: it signs one certificate per holder, and nothing else is trusted.

Keys are ECDSA P-256, which zenoh's TLS and every other current stack accept. A certificate is good for one use, a
server's for the gate and a client's for all others, so that a stolen monitor's certificate cannot play the gate.
"""

from __future__ import annotations

import ipaddress
from dataclasses import dataclass
from datetime import datetime, timedelta

from cryptography import x509
from cryptography.hazmat.primitives import hashes, serialization
from cryptography.hazmat.primitives.asymmetric import ec
from cryptography.x509.oid import ExtendedKeyUsageOID, NameOID

from motiondlo.errors import MotionDLOError
from motiondlo.security.roles import role_of

AUTHORITY_DAYS = 3650
CERTIFICATE_DAYS = 365
CLOCK_SKEW = timedelta(minutes=10)
"""Certificates hold from a little before they are made: the clocks of a cell's machines differ."""


@dataclass(frozen=True)
class Issued:
    """A certificate and its private key, both PEM."""

    certificate_pem: bytes
    key_pem: bytes


def make_authority(cell: str, now: datetime, days: int = AUTHORITY_DAYS) -> Issued:
    """A self-signed authority for ``cell``. It may sign holders' certificates, no further authorities."""
    key = ec.generate_private_key(ec.SECP256R1())
    name = _name(f"{cell} authority", cell)
    certificate = (
        _builder(name, name, key.public_key(), now, now + timedelta(days=days))
        .add_extension(x509.BasicConstraints(ca=True, path_length=0), critical=True)
        .add_extension(_key_usage(signs_certificates=True), critical=True)
        .sign(key, hashes.SHA256())
    )
    return _pem(certificate, key)


def issue(
    authority: Issued, common_name: str, now: datetime, days: int = CERTIFICATE_DAYS, hosts: tuple[str, ...] = ()
) -> Issued:
    """A certificate for the holder ``common_name``, never longer valid than the authority.

    hosts: names and addresses under which the gate is reached; only the gate's certificate has them.
    Raises MotionDLOError: a name without a role, an expired authority, hosts missing or wrong.
    """
    role = role_of(common_name)
    signer = x509.load_pem_x509_certificate(authority.certificate_pem)
    signer_key = serialization.load_pem_private_key(authority.key_pem, None)
    if not isinstance(signer_key, ec.EllipticCurvePrivateKey):
        raise MotionDLOError("The authority's key is of another kind.", "Make an authority: motiondlo certs init.")
    if signer.not_valid_after_utc <= now:
        raise MotionDLOError("The authority has expired.", "Make a new one in another folder: motiondlo certs init.")
    if role.listens != bool(hosts):
        raise MotionDLOError(
            f"{common_name} {'needs' if role.listens else 'takes no'} hosts.",
            "Only the gate is reached at a host: certs issue daemon --host NAME.",
        )
    key = ec.generate_private_key(ec.SECP256R1())
    use = ExtendedKeyUsageOID.SERVER_AUTH if role.listens else ExtendedKeyUsageOID.CLIENT_AUTH
    names = [_host(host) for host in hosts] or [x509.DNSName(common_name)]
    until = min(now + timedelta(days=days), signer.not_valid_after_utc)
    certificate = (
        _builder(_name(common_name, cell_of(signer)), signer.subject, key.public_key(), now, until)
        .add_extension(x509.BasicConstraints(ca=False, path_length=None), critical=True)
        .add_extension(_key_usage(signs_certificates=False), critical=True)
        .add_extension(x509.ExtendedKeyUsage([use]), critical=False)
        .add_extension(x509.SubjectAlternativeName(names), critical=False)
        .add_extension(_issuer_identifier(signer), critical=False)
        .sign(signer_key, hashes.SHA256())
    )
    return _pem(certificate, key)


def cell_of(certificate: x509.Certificate) -> str:
    """The cell that a certificate was made for, or an empty text."""
    return _text(certificate, NameOID.ORGANIZATIONAL_UNIT_NAME)


def common_name_of(certificate: x509.Certificate) -> str:
    """The holder that a certificate names, or an empty text."""
    return _text(certificate, NameOID.COMMON_NAME)


def hosts_of(certificate: x509.Certificate) -> tuple[str, ...]:
    """Names and addresses under which the certificate's holder is reached."""
    try:
        names = certificate.extensions.get_extension_for_class(x509.SubjectAlternativeName).value
    except x509.ExtensionNotFound:
        return ()
    addresses = [str(address) for address in names.get_values_for_type(x509.IPAddress)]
    return (*names.get_values_for_type(x509.DNSName), *addresses)


def _text(certificate: x509.Certificate, oid: x509.ObjectIdentifier) -> str:
    found = certificate.subject.get_attributes_for_oid(oid)
    return str(found[0].value) if found else ""


def _name(common_name: str, cell: str) -> x509.Name:
    return x509.Name(
        [
            x509.NameAttribute(NameOID.ORGANIZATION_NAME, "MotionDLO"),
            x509.NameAttribute(NameOID.ORGANIZATIONAL_UNIT_NAME, cell),
            x509.NameAttribute(NameOID.COMMON_NAME, common_name),
        ]
    )


def _builder(
    subject: x509.Name, issuer: x509.Name, key: ec.EllipticCurvePublicKey, now: datetime, until: datetime
) -> x509.CertificateBuilder:
    return (
        x509.CertificateBuilder()
        .subject_name(subject)
        .issuer_name(issuer)
        .public_key(key)
        .serial_number(x509.random_serial_number())
        .not_valid_before(now - CLOCK_SKEW)
        .not_valid_after(until)
        .add_extension(x509.SubjectKeyIdentifier.from_public_key(key), critical=False)
    )


def _issuer_identifier(signer: x509.Certificate) -> x509.AuthorityKeyIdentifier:
    own = signer.extensions.get_extension_for_class(x509.SubjectKeyIdentifier).value
    return x509.AuthorityKeyIdentifier.from_issuer_subject_key_identifier(own)


def _key_usage(signs_certificates: bool) -> x509.KeyUsage:
    return x509.KeyUsage(
        digital_signature=not signs_certificates,
        key_cert_sign=signs_certificates,
        crl_sign=signs_certificates,
        content_commitment=False,
        key_encipherment=False,
        data_encipherment=False,
        key_agreement=False,
        encipher_only=False,
        decipher_only=False,
    )


def _host(host: str) -> x509.GeneralName:
    try:
        return x509.IPAddress(ipaddress.ip_address(host))
    except ValueError:
        pass
    try:
        return x509.DNSName(host)
    except ValueError:
        raise MotionDLOError(
            f"{host!r} is no host.", "Give a name or an address, for instance cell-pc.local."
        ) from None


def _pem(certificate: x509.Certificate, key: ec.EllipticCurvePrivateKey) -> Issued:
    return Issued(
        certificate.public_bytes(serialization.Encoding.PEM),
        key.private_bytes(serialization.Encoding.PEM, serialization.PrivateFormat.PKCS8, serialization.NoEncryption()),
    )
