"""Time per update and per stage on this machine: decoding, tracker, its message and fusion, as a cell runs them.

With --sweep no recording is needed: a made-up scene with more and more cables and events, on one core.
"""

from __future__ import annotations

from argparse import ArgumentParser, Namespace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from motiondlo.cli.track_arguments import PROFILES, add_loop_arguments, options_of
from motiondlo.errors import MotionDLOError

if TYPE_CHECKING:
    from rich.table import Table


def add_arguments(parser: ArgumentParser) -> None:
    """Arguments of ``motiondlo bench``."""
    parser.add_argument("recording", type=Path, nargs="?", metavar="RECORDING", help="folder with events.raw")
    parser.add_argument("--sweep", action="store_true", help="1 to 8 cables and 1 to 30 million events/s, made up")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the figures here")
    parser.add_argument(
        "--profile",
        choices=PROFILES,
        action="append",
        help="only this one (may be repeated; default: all, with --sweep the default one)",
    )
    add_loop_arguments(parser)


def run(args: Namespace) -> int:
    """Time each profile, print, write."""
    if args.sweep == (args.recording is not None):
        raise MotionDLOError("either a recording or --sweep is timed.", "Name a RECORDING, or give --sweep alone.")
    return _sweep(args) if args.sweep else _recording(args)


def _recording(args: Namespace) -> int:
    from motiondlo.cli.output import check_writable, write_json
    from motiondlo.cli.progress import progress_bar
    from motiondlo.cli.tables import console
    from motiondlo.offline.bench import measure
    from motiondlo.offline.machine import machine_facts
    from motiondlo.recording.layout import open_recording

    if args.json is not None:
        check_writable(args.json)
    recording = open_recording(args.recording)
    facts = machine_facts()
    results: dict[str, dict[str, Any]] = {}
    for profile in args.profile or PROFILES:
        with progress_bar(f"timing {profile}", args.quiet) as progress:
            results[profile] = measure(recording, options_of(args, profile), progress).as_json()
    if args.json is not None:
        write_json(args.json, {"machine": facts, "profiles": results})
    if not args.quiet:
        console().print(_table(recording.name, results))
        console().print(
            f"{facts['cpu']}, {facts['cores']} cores, load {facts['load_1min']}", highlight=False, soft_wrap=True
        )
    return 0


def _sweep(args: Namespace) -> int:
    from motiondlo.cli.output import check_writable, write_json
    from motiondlo.cli.progress import progress_bar
    from motiondlo.cli.sweep_output import print_sweep
    from motiondlo.offline.machine import machine_facts
    from motiondlo.offline.sweep import fit_load, sweep

    if args.json is not None:
        check_writable(args.json)
    document: dict[str, Any] = {"machine": machine_facts(), "profiles": {}}
    for profile in args.profile or PROFILES[:1]:
        with progress_bar(f"sweeping {profile}", args.quiet) as progress:
            points = sweep(profile, args.update_us, progress=progress)
        fit = fit_load(points)
        document["profiles"][profile] = {
            "points": [point.as_json() for point in points],
            "fit": None if fit is None else fit.as_json(),
        }
        if not args.quiet:
            print_sweep(profile, points, fit)
    if args.json is not None:
        write_json(args.json, document)
    return 0


def _table(name: str, results: dict[str, dict[str, Any]]) -> Table:
    from motiondlo.cli.tables import compact_table, figure

    table = compact_table(
        f"{name}: ms per update",
        "stages: of the updates in which something moves (of all, where nothing does); not used in an update: 0; "
        "tracker: without decoding and fusion, which a cell does in processes of their own",
    )
    table.add_column("")
    for profile in results:
        for heading in (f"{profile} p50", "p99", "max"):
            table.add_column(heading, justify="right", no_wrap=True)
    found = dict.fromkeys(stage for result in results.values() for stage in result["stages_ms"])
    stages = sorted(found, key=lambda stage: (stage == "fusion", stage == "publication"))  # last in all profiles
    rows = [
        ("update", "update_ms"),
        ("update, moving", "update_moving_ms"),
        ("update, CPU", "update_cpu_ms"),
        ("update, tracker", "update_tracker_ms"),
    ]
    for label, key in rows:
        cells = [figure(result[key][p], 3) for result in results.values() for p in ("p50", "p99", "max")]
        table.add_row(label, *cells, style="bold")
    for stage in stages:
        cells = []
        for result in results.values():
            times = _shown(result).get(stage, {"p50": None, "p99": None})
            cells += [figure(times["p50"], 3), figure(times["p99"], 3), ""]
        table.add_row(f"  {stage}", *cells)
    table.add_row(
        "events/s",
        *(cell for result in results.values() for cell in (f"{result['events_per_s'] / 1e6:.1f} M", "", "")),
    )
    return table


def _shown(result: dict[str, Any]) -> dict[str, dict[str, float | None]]:
    """At rest most stages do nothing: what an update costs shows while something moves."""
    key = "stages_ms" if result["update_moving_ms"]["p50"] is None else "stages_moving_ms"
    stages: dict[str, dict[str, float | None]] = result[key]
    return stages
