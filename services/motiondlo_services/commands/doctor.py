"""Look at this machine, and at a cell's configuration if one is given; say what to do about each finding."""

from __future__ import annotations

from argparse import ArgumentParser, Namespace
from pathlib import Path


def add_arguments(parser: ArgumentParser) -> None:
    """Arguments of ``motiondlo doctor``."""
    parser.add_argument("--config", type=Path, metavar="FILE", help="the cell's configuration")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the findings here")


def run(args: Namespace) -> int:
    """Examine, print, write; 1 when something does not work."""
    from rich.console import Console
    from rich.markup import escape
    from rich.table import Table

    from motiondlo.cli.output import write_json
    from motiondlo_services.doctor.cell import check_cell
    from motiondlo_services.doctor.findings import Verdict
    from motiondlo_services.doctor.machine import check_machine

    findings = check_machine()
    if args.config is not None:
        findings += check_cell(args.config)
    failures = [finding for finding in findings if finding.verdict == Verdict.FAILURE]
    if args.json is not None:
        write_json(args.json, {"ok": not failures, "findings": [finding.as_dict() for finding in findings]})
    if not args.quiet:
        colours = {Verdict.OK: "green", Verdict.WARNING: "yellow", Verdict.FAILURE: "red"}
        table = Table(title="motiondlo doctor", title_justify="left")
        for column in ("", "subject", "finding", "what to do"):
            table.add_column(column, overflow="fold")
        for finding in findings:
            colour = colours[finding.verdict]
            # Sections of the configuration are written in brackets, which rich would take for markup.
            texts = [escape(text) for text in (finding.subject, finding.what, finding.what_to_do)]
            table.add_row(f"[{colour}]{finding.verdict.value}[/]", *texts)
        Console().print(table)
    return 1 if failures else 0
