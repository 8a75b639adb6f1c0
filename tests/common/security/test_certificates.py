"""Certificates: what they say, how they are kept, and that every defect is found."""

from __future__ import annotations

import os
import shutil
import stat
from collections.abc import Callable
from datetime import timedelta
from pathlib import Path
from ssl import DER_cert_to_PEM_cert

import pytest
from cryptography import x509
from cryptography.hazmat.primitives.asymmetric import ec
from cryptography.hazmat.primitives.serialization import Encoding
from cryptography.x509.oid import ExtendedKeyUsageOID
from tests.common.security.conftest import NOW

from motiondlo.cli.main import main
from motiondlo.errors import MotionDLOError
from motiondlo.security.certificates import init, issue_holder, renew, table
from motiondlo.security.folder import AUTHORITY, MAX_PEM_BYTES, CertificateFolder
from motiondlo.security.inspection import describe, inspect, load_certificate

HOLDERS = ("daemon", "gateway.plc", "monitor")


def complaints(folder: CertificateFolder, now: object = NOW) -> dict[str, str]:
    assert isinstance(now, type(NOW))
    return {entry.name: entry.what for entry in inspect(folder, folder.holders(), now)}


def test_a_fresh_folder_has_nothing_to_complain_of(folder: CertificateFolder) -> None:
    assert folder.holders() == HOLDERS
    assert complaints(folder) == {}
    assert all(row["ok"] for row in table(folder, NOW))


def test_keys_are_for_the_owner_alone_whatever_the_umask(tmp_path: Path) -> None:
    before = os.umask(0)
    try:
        folder = CertificateFolder(tmp_path / "open" / "certs")
        init(folder, "cell1", NOW)
        issue_holder(folder, "monitor", "", NOW)
        renew(folder, "monitor", NOW)
    finally:
        os.umask(before)
    assert stat.S_IMODE(folder.path.stat().st_mode) == 0o700
    for name in (AUTHORITY, "monitor"):
        assert stat.S_IMODE(folder.key(name).stat().st_mode) == 0o600


def test_a_certificate_says_who_for_what_and_how_long(folder: CertificateFolder) -> None:
    gate, monitor = (load_certificate(folder.certificate(name)) for name in ("daemon", "monitor"))
    assert describe(folder.certificate("daemon")).hosts == ("localhost", "127.0.0.1")
    for certificate, use in ((gate, ExtendedKeyUsageOID.SERVER_AUTH), (monitor, ExtendedKeyUsageOID.CLIENT_AUTH)):
        key = certificate.public_key()
        assert isinstance(key, ec.EllipticCurvePublicKey)
        assert key.curve.name == "secp256r1"
        assert list(certificate.extensions.get_extension_for_class(x509.ExtendedKeyUsage).value) == [use]
        assert not certificate.extensions.get_extension_for_class(x509.BasicConstraints).value.ca
        assert certificate.not_valid_after_utc == NOW + timedelta(days=365)
        assert certificate.not_valid_before_utc < NOW
    assert gate.serial_number != monitor.serial_number


def test_no_certificate_outlives_its_authority(folder: CertificateFolder) -> None:
    late = NOW + timedelta(days=3600)
    issue_holder(folder, "monitor", "late", late)
    assert describe(folder.certificate("monitor.late")).until_utc == describe(folder.certificate(AUTHORITY)).until_utc
    with pytest.raises(MotionDLOError, match="authority has expired"):
        issue_holder(folder, "monitor", "later", NOW + timedelta(days=3651))


def test_nothing_is_overwritten(folder: CertificateFolder) -> None:
    before = folder.read("monitor")
    for again in (lambda: init(folder, "cell1", NOW), lambda: issue_holder(folder, "monitor", "", NOW)):
        with pytest.raises(MotionDLOError, match="nothing is overwritten"):
            again()
    folder.key("monitor.trap").symlink_to(folder.path / "elsewhere")
    with pytest.raises(MotionDLOError, match="nothing is overwritten"):
        issue_holder(folder, "monitor", "trap", NOW)
    assert folder.read("monitor") == before
    assert not (folder.path / "elsewhere").exists()


def test_renewal_changes_the_key_and_keeps_the_hosts(folder: CertificateFolder) -> None:
    before = folder.read("daemon")
    renew(folder, "daemon", NOW + timedelta(days=300))
    assert folder.read("daemon").key_pem != before.key_pem
    assert describe(folder.certificate("daemon")).hosts == ("localhost", "127.0.0.1")
    assert complaints(folder, NOW + timedelta(days=300)) == {}
    assert not list(folder.path.glob("*.new"))


@pytest.mark.parametrize(
    ("role", "name", "hosts", "match"),
    [
        ("king", "", (), "no role"),
        ("monitor", "../../etc/x", (), "no name"),
        ("monitor", "A b", (), "no name"),
        ("daemon", "", (), "needs hosts"),
        ("monitor", "", ("localhost",), "takes no hosts"),
        ("daemon", "", ("höst",), "no host"),
    ],
)
def test_a_wrong_holder_is_refused(
    folder: CertificateFolder, role: str, name: str, hosts: tuple[str, ...], match: str
) -> None:
    before = sorted(folder.path.iterdir())
    with pytest.raises(MotionDLOError, match=match):
        issue_holder(folder, role, name, NOW, hosts=hosts)
    assert sorted(folder.path.iterdir()) == before


def foreign(folder: CertificateFolder) -> None:
    other = CertificateFolder(folder.path.with_name("other"))
    init(other, "cell1", NOW)
    issue_holder(other, "monitor", "", NOW)
    folder.replace("monitor", other.read("monitor"))


def damage_inside(folder: CertificateFolder) -> None:
    """Still a certificate from outside; its extensions no longer parse."""
    der = bytearray(load_certificate(folder.certificate("monitor")).public_bytes(Encoding.DER))
    der[der.index(bytes.fromhex("0603551d0f")) + 8] += 1
    folder.certificate("monitor").write_bytes(DER_cert_to_PEM_cert(bytes(der)).encode())


DEFECTS: dict[str, tuple[Callable[[CertificateFolder], object], str, str]] = {
    "open key": (lambda f: f.key("monitor").chmod(0o640), "monitor", "open to others"),
    "open folder": (lambda f: f.path.chmod(0o755), "folder", "open to others"),
    "open authority": (lambda f: f.key(AUTHORITY).chmod(0o644), AUTHORITY, "open to others"),
    "no key": (lambda f: f.key("monitor").unlink(), "monitor", "No such file"),
    "no authority": (lambda f: f.certificate(AUTHORITY).unlink(), AUTHORITY, "No such file"),
    "another's key": (lambda f: shutil.copy(f.key("daemon"), f.key("monitor")), "monitor", "another one's"),
    "garbage key": (lambda f: f.key("monitor").write_bytes(b"\0" * 99), "monitor", "unreadable"),
    "garbage": (lambda f: f.certificate("monitor").write_text("no"), "monitor", "no certificate"),
    "damaged inside": (damage_inside, "monitor", "no certificate"),
    "a giant": (lambda f: f.certificate("monitor").write_bytes(bytes(MAX_PEM_BYTES + 1)), "monitor", "too large"),
    "another's certificate": (lambda f: f.replace("monitor", f.read("gateway.plc")), "monitor", "belongs to"),
    "another's use": (lambda f: f.replace("monitor", f.read("daemon")), "monitor", "another use"),
    "another authority": (foreign, "monitor", "not signed by this authority"),
    "no authority at all": (lambda f: f.replace(AUTHORITY, f.read("monitor")), AUTHORITY, "is no authority"),
}


@pytest.mark.parametrize("defect", DEFECTS)
def test_every_defect_is_found_and_is_serious(folder: CertificateFolder, defect: str) -> None:
    spoil, name, what = DEFECTS[defect]
    spoil(folder)
    found = [entry for entry in inspect(folder, folder.holders(), NOW) if entry.name == name]
    assert any(what in entry.what for entry in found), found
    assert all(entry.serious and entry.what_to_do for entry in found)


def test_expiry_is_announced_and_then_serious(folder: CertificateFolder) -> None:
    def of(days: float) -> list[tuple[bool, str]]:
        found = inspect(folder, ["monitor"], NOW + timedelta(days=days))
        return [(entry.serious, entry.what) for entry in found]

    assert of(334) == []
    assert of(346) == [(False, "expires in 19 days")]
    assert of(366) == [(True, "expired on 2031-05-01")]
    assert "holds only from" in of(-1)[-1][1]


def test_the_command_makes_lists_and_warns(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    where = ["--dir", str(tmp_path / "certs")]
    assert main(["certs", "init", "--cell", "cell1", *where]) == 0
    assert main(["certs", "issue", "daemon", "--host", "localhost", *where]) == 0
    assert main(["certs", "issue", "monitor", "--name", "hall", "--days", "20", *where]) == 0
    assert "monitor.hall: expires in 20 days" in capsys.readouterr().err
    assert main(["certs", "list", *where]) == 0
    listing = capsys.readouterr().out
    assert "monitor.hall" in listing
    assert "expires in" in listing
    assert main(["certs", "renew", "monitor.hall", "--quiet", *where]) == 0
    assert capsys.readouterr() == ("", "")
    (tmp_path / "certs" / "daemon.key").chmod(0o644)
    assert main(["certs", "list", *where]) == 1
    assert main(["certs", "init", "--cell", "cell1", *where]) == 1
    assert "nothing is overwritten" in capsys.readouterr().err
    assert main(["certs", "issue", "monitor", "--days", "0", *where]) == 1
    assert main(["certs", "list", "--dir", str(tmp_path / "nowhere")]) == 1
