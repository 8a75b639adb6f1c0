"""The cell's certificates: who may come in through the gate, and as what.

motiondlo certs init --cell cell1                    the cell's authority
motiondlo certs issue daemon --host cell-pc.local    the gate's own certificate
motiondlo certs issue monitor --name hall-screen     one per holder; roles: daemon, gateway, monitor
motiondlo certs list                                 what there is, and what is wrong with it
motiondlo certs renew monitor.hall-screen            a new key and certificate in the place of the old
"""

from __future__ import annotations

import sys
from argparse import SUPPRESS, ArgumentParser, Namespace
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from motiondlo.security.folder import CertificateFolder

DEFAULT_DIR = Path("certs")


def add_arguments(parser: ArgumentParser) -> None:
    """Arguments of ``motiondlo certs``."""
    actions = parser.add_subparsers(dest="action", required=True, metavar="init|issue|list|renew")
    init = actions.add_parser("init", help="make the cell's authority")
    init.add_argument("--cell", required=True, metavar="NAME", help="the cell's name, as in [cell] name")
    init.add_argument("--days", type=int, metavar="N", help="valid for so long (default: 3650)")
    issue = actions.add_parser("issue", help="make a holder's key and certificate")
    issue.add_argument("role", metavar="ROLE", help="daemon (the gate), gateway or monitor")
    issue.add_argument("--name", default="", metavar="HOLDER", help="tells holders of the same role apart")
    issue.add_argument(
        "--host", action="append", default=[], metavar="HOST", help="name or address of the gate; may be repeated"
    )
    issue.add_argument("--days", type=int, metavar="N", help="valid for so long (default: 365)")
    listing = actions.add_parser("list", help="show and check all certificates")
    listing.add_argument("--json", type=Path, metavar="FILE", help="write the list here")
    renew = actions.add_parser("renew", help="replace keys and certificates by new ones")
    renew.add_argument("names", nargs="+", metavar="NAME", help="as certs list shows them")
    renew.add_argument("--days", type=int, metavar="N", help="valid for so long (default: 365)")
    for action in (init, issue, listing, renew):
        action.add_argument(
            "--dir", type=Path, default=DEFAULT_DIR, metavar="DIR", help=f"their folder (default: {DEFAULT_DIR})"
        )
        # The command's own switches, also after the action's name.
        action.add_argument("--debug", action="store_true", default=SUPPRESS, help=SUPPRESS)
        action.add_argument("--quiet", action="store_true", default=SUPPRESS, help=SUPPRESS)


def run(args: Namespace) -> int:
    """Make, list or renew; 1 when the list shows something that does not work."""
    from motiondlo.security.certificates import init, issue_holder, renew
    from motiondlo.security.folder import AUTHORITY, CertificateFolder

    folder, now = CertificateFolder(args.dir), datetime.now(UTC)
    if args.action == "list":
        return _list(folder, now, args.json, args.quiet)
    made: list[str] = []
    if args.action == "init":
        init(folder, args.cell, now, args.days)
        made = [AUTHORITY]
    elif args.action == "issue":
        made = [issue_holder(folder, args.role, args.name, now, args.days, tuple(args.host))]
    else:
        for name in args.names:
            renew(folder, name, now, args.days)
            made.append(name)
    if not args.quiet:
        for name in made:
            print(f"{folder.certificate(name)} and {folder.key(name)}")
    _warn(folder, now)
    return 0


def _list(folder: CertificateFolder, now: datetime, json: Path | None, quiet: bool) -> int:
    from motiondlo.cli.output import check_writable, write_json
    from motiondlo.cli.tables import compact_table, console
    from motiondlo.security.certificates import table

    if json is not None:
        check_writable(json)
    rows = table(folder, now)
    good = all(row["ok"] for row in rows)
    if json is not None:
        write_json(json, {"ok": good, "certificates": rows})
    if not quiet:
        shown = compact_table(str(folder.path))
        for column in ("name", "cell", "valid until", "days left", "hosts", "what is wrong"):
            shown.add_column(column, overflow="fold")
        for row in rows:
            hosts, problems = row["hosts"], row["problems"]
            assert isinstance(hosts, list)
            assert isinstance(problems, list)
            days_left = "" if row["days_left"] is None else str(row["days_left"])
            cells = (str(row["name"]), str(row["cell"]), str(row["until"]), days_left)
            shown.add_row(*cells, ", ".join(hosts), "; ".join(problems) or "nothing")
        console().print(shown)
    return 0 if good else 1


def _warn(folder: CertificateFolder, now: datetime) -> None:
    from motiondlo.security.inspection import inspect

    for complaint in inspect(folder, folder.holders(), now):
        print(f"motiondlo certs: {complaint.name}: {complaint.what}. {complaint.what_to_do}", file=sys.stderr)
