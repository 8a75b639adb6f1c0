"""What ``motiondlo certs`` does to a folder: make the authority, issue a holder's pair, renew it."""

from __future__ import annotations

import re
from datetime import datetime

from motiondlo.errors import MotionDLOError
from motiondlo.messages.header import NAME_PATTERN
from motiondlo.security.authority import AUTHORITY_DAYS, CERTIFICATE_DAYS, issue, make_authority
from motiondlo.security.folder import AUTHORITY, CertificateFolder
from motiondlo.security.inspection import describe, inspect
from motiondlo.security.roles import common_name, role_named, role_of

MAX_DAYS = 20 * 365


def init(folder: CertificateFolder, cell: str, now: datetime, days: int | None = None) -> None:
    """Make the authority of ``cell``, and the folder if it is not there.

    Raises MotionDLOError: a wrong name or number of days, or an authority that is there already.
    """
    if re.fullmatch(NAME_PATTERN, cell) is None:
        raise MotionDLOError(f"{cell!r} is no cell name.", "Use letters, digits, '_', '-' and '.'.")
    issued = make_authority(cell, now, _checked(days, AUTHORITY_DAYS))
    folder.create()
    folder.write(AUTHORITY, issued)


def issue_holder(
    folder: CertificateFolder,
    role: str,
    name: str,
    now: datetime,
    days: int | None = None,
    hosts: tuple[str, ...] = (),
) -> str:
    """Make the pair of a new holder; gives its common name.

    Raises MotionDLOError: no authority, no such role, a wrong name, or a pair that is there already.
    """
    full = common_name(role_named(role), name)
    folder.write(full, issue(folder.read(AUTHORITY), full, now, _checked(days, CERTIFICATE_DAYS), hosts))
    return full


def renew(folder: CertificateFolder, name: str, now: datetime, days: int | None = None) -> None:
    """A new key and certificate for a holder, for the same hosts, in the place of the old ones.

    Raises MotionDLOError: no authority, or no certificate of that holder.
    """
    old = describe(folder.certificate(name))
    hosts = old.hosts if role_of(name).listens else ()
    folder.replace(name, issue(folder.read(AUTHORITY), name, now, _checked(days, CERTIFICATE_DAYS), hosts))


def table(folder: CertificateFolder, now: datetime) -> list[dict[str, object]]:
    """One row per certificate, the authority's first; ``problems`` is empty where all is well, ``ok`` is false where
    something does not work. Raises MotionDLOError when there is no folder."""
    if not folder.path.is_dir():
        raise MotionDLOError(f"{folder.path} is not there.", "Run motiondlo certs init, or give --dir.")
    names = (AUTHORITY, *folder.holders())
    complaints = inspect(folder, names[1:], now)
    rows: list[dict[str, object]] = []
    for name in names:
        own = [entry for entry in complaints if entry.name == name or (name == AUTHORITY and entry.name == "folder")]
        row: dict[str, object] = {"name": name, "cell": "", "until": "", "days_left": None, "hosts": []}
        try:
            facts = describe(folder.certificate(name))
        except MotionDLOError:
            pass  # the inspection has a complaint about it
        else:
            hosts = list(facts.hosts) if facts.hosts != (name,) else []
            days_left = round(facts.days_left(now))
            row |= {"cell": facts.cell, "until": f"{facts.until_utc:%Y-%m-%d}", "days_left": days_left, "hosts": hosts}
        row["problems"] = [f"{entry.what}: {entry.what_to_do}" for entry in own]
        row["ok"] = not any(entry.serious for entry in own)
        rows.append(row)
    return rows


def _checked(days: int | None, default: int) -> int:
    if days is None:
        return default
    if not 1 <= days <= MAX_DAYS:
        raise MotionDLOError(f"--days {days}: should be 1 to {MAX_DAYS}.", f"The default is {default}.")
    return days
