"""Summarise a recording, or a bare events file: format, duration, rates, triggers, frames, damage."""

from __future__ import annotations

from argparse import ArgumentParser, Namespace
from pathlib import Path


def add_arguments(parser: ArgumentParser) -> None:
    """Arguments of ``motiondlo info``."""
    parser.add_argument("path", type=Path, metavar="PATH", help="folder of a recording, or a .raw file")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the summary here")


def run(args: Namespace) -> int:
    """Summarise, print, write."""
    from motiondlo.cli.output import check_writable, write_json
    from motiondlo.cli.tables import compact_table, console
    from motiondlo.offline.info import summarise

    if args.json is not None:
        check_writable(args.json)
    facts = summarise(args.path).as_dict()
    if args.json is not None:
        write_json(args.json, facts)
    if not args.quiet:
        table = compact_table(str(args.path))
        table.add_column("")
        table.add_column("")
        for name, value in facts.items():
            table.add_row(name.replace("_", " "), _shown(value))
        console().print(table)
    return 0


def _shown(value: object) -> str:
    if isinstance(value, dict):
        return ", ".join(f"{key} {count}" for key, count in value.items()) or "none"
    return str(value)
