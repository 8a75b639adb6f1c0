"""The folder that certificates and keys live in: private, written once, never half a file.

authority.crt           what everyone needs to know whom to trust
authority.key           what signs; only ``motiondlo certs`` needs it, and it may be kept elsewhere
<common name>.crt, .key one pair per holder: daemon, gateway, monitor.hall-screen ...
"""

from __future__ import annotations

import os
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from motiondlo.errors import MotionDLOError
from motiondlo.security.authority import Issued

AUTHORITY = "authority"
FOLDER_MODE = 0o700
KEY_MODE = 0o600
CERTIFICATE_MODE = 0o644
MAX_PEM_BYTES = 64 << 10


@dataclass(frozen=True)
class CertificateFolder:
    """One cell's certificates."""

    path: Path

    def certificate(self, name: str) -> Path:
        """File of the certificate of ``name``."""
        return self.path / f"{name}.crt"

    def key(self, name: str) -> Path:
        """File of the private key of ``name``."""
        return self.path / f"{name}.key"

    def create(self) -> None:
        """Make the folder, private; an existing one is made private. Raises MotionDLOError where that fails."""
        try:
            self.path.mkdir(mode=FOLDER_MODE, parents=True, exist_ok=True)
            self.path.chmod(FOLDER_MODE)
        except OSError as error:
            raise _failed(self.path, error) from error

    def holders(self) -> tuple[str, ...]:
        """Names of all holders with a certificate here, without the authority."""
        return tuple(sorted(path.stem for path in self.path.glob("*.crt") if path.stem != AUTHORITY))

    def read(self, name: str) -> Issued:
        """Certificate and key of ``name``. Raises MotionDLOError when one is missing, too large or unreadable."""
        return Issued(read_pem(self.certificate(name)), read_pem(self.key(name)))

    def write(self, name: str, issued: Issued) -> None:
        """Write a new pair. Raises MotionDLOError when there is one already: keys are never overwritten."""
        for path in (self.key(name), self.certificate(name)):
            if path.exists() or path.is_symlink():
                raise MotionDLOError(
                    f"{path} exists, and nothing is overwritten.", "Move it away, or use motiondlo certs renew."
                )
        _write_new(self.key(name), issued.key_pem, KEY_MODE)
        _write_new(self.certificate(name), issued.certificate_pem, CERTIFICATE_MODE)

    def replace(self, name: str, issued: Issued) -> None:
        """Put a new pair in the place of an old one; a reader sees whole files at any time."""
        for path, data, mode in (
            (self.key(name), issued.key_pem, KEY_MODE),
            (self.certificate(name), issued.certificate_pem, CERTIFICATE_MODE),
        ):
            fresh = path.with_name(f"{path.name}.new")
            fresh.unlink(missing_ok=True)
            _write_new(fresh, data, mode)
            fresh.replace(path)


def read_pem(path: Path) -> bytes:
    """The file's bytes. Raises MotionDLOError when it is missing, unreadable or far larger than a certificate."""
    try:
        with path.open("rb") as file:
            data = file.read(MAX_PEM_BYTES + 1)
    except OSError as error:
        raise MotionDLOError(f"{path}: {error.strerror}.", "Make it with motiondlo certs.") from error
    if len(data) > MAX_PEM_BYTES:
        raise MotionDLOError(f"{path}: too large for a certificate.", "Make it anew with motiondlo certs.")
    return data


def _write_new(path: Path, data: bytes, mode: int) -> None:
    # The mode is the file's from its first moment on: there is no time at which another user could open it.
    try:
        handle = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_NOFOLLOW, mode)
    except OSError as error:
        raise _failed(path, error) from error
    try:
        with os.fdopen(handle, "wb") as file:
            file.write(data)
            file.flush()
            os.fsync(file.fileno())
    except OSError as error:
        with suppress(OSError):
            path.unlink()
        raise _failed(path, error) from error


def _failed(path: Path, error: OSError) -> MotionDLOError:
    return MotionDLOError(f"{path}: cannot be written ({error.strerror}).", "Choose another folder with --dir.")
