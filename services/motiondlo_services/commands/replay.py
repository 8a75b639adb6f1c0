"""Play a recording back into a cell at real speed: all the real daemons, the recording in the cameras' place."""

from __future__ import annotations

from argparse import ArgumentParser, Namespace
from pathlib import Path


def add_arguments(parser: ArgumentParser) -> None:
    """Arguments of ``motiondlo replay``."""
    parser.add_argument("recording", type=Path, metavar="RECORDING", help="folder with events.raw")
    parser.add_argument(
        "--config", type=Path, metavar="FILE", help="the cell whose name, endpoints and parameters are used"
    )
    parser.add_argument("--speed", type=float, default=1.0, metavar="X", help="1 is real time (default); 0.1 slower")
    parser.add_argument("--times", type=int, default=1, metavar="N", help="play it so often; 0 until Ctrl-C")


def run(args: Namespace) -> int:
    """Play it, then stop the daemons."""
    import itertools
    import sys

    from motiondlo_services.cell_config import bus_section, check_configuration, wanted_processes
    from motiondlo_services.replay_cell import replay_config
    from motiondlo_services.runtime.shutdown import StopFlag
    from motiondlo_services.supervisor import Supervisor, supervise

    def say(line: str) -> None:
        if not args.quiet:
            print(f"motiondlo replay: {line}", file=sys.stderr, flush=True)  # noqa: T201

    stop = StopFlag().install()
    with replay_config(args.config, args.recording, args.speed) as config:
        cell = check_configuration(config)
        cell.event_from_rgb()
        say(f"state: motiondlo/{cell.cell.name}/state at {bus_section(config).all_endpoints()['fusion']}")
        for turn in itertools.count(1):
            say(
                f"playing {args.recording.resolve().name}" + (f", {turn} of {args.times or 'many'}" * (args.times != 1))
            )
            supervisor = Supervisor(config, wanted_processes(config))
            supervise(supervisor, stopped=lambda: bool(stop), say=say, until_finished=("event-ingest",))
            if stop or turn == args.times:
                return 0
    return 0
