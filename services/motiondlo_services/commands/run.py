"""Start a cell's daemons under one supervisor; Ctrl-C stops them cleanly."""

from __future__ import annotations

from argparse import ArgumentParser, Namespace
from pathlib import Path


def add_arguments(parser: ArgumentParser) -> None:
    """Arguments of ``motiondlo run``."""
    parser.add_argument("--config", type=Path, required=True, metavar="FILE", help="the cell's configuration")
    parser.add_argument(
        "--until-finished", action="store_true", help="stop when the recording has been played, instead of Ctrl-C"
    )


def run(args: Namespace) -> int:
    """Supervise until told to stop."""
    import sys

    from motiondlo_services.cell_config import bus_section, check_configuration, check_source, wanted_processes
    from motiondlo_services.runtime.shutdown import StopFlag
    from motiondlo_services.supervisor import Supervisor, supervise

    def say(line: str) -> None:
        if not args.quiet:
            print(f"motiondlo run: {line}", file=sys.stderr, flush=True)  # noqa: T201

    cell = check_configuration(args.config)
    check_source(cell)
    cell.event_from_rgb()
    cell.background()
    stop = StopFlag().install()
    rows = wanted_processes(args.config)
    say(f"cell {cell.cell.name}: starting {', '.join(row.name for row in rows)}")
    say(f"state: motiondlo/{cell.cell.name}/state at {bus_section(args.config).all_endpoints()['fusion']}")
    supervise(
        Supervisor(args.config.resolve(), rows),
        stopped=lambda: bool(stop),
        say=say,
        until_finished=("event-ingest",) if args.until_finished else (),
    )
    return 0
