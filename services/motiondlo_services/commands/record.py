"""Record a running cell in the layout that every tool reads."""

from __future__ import annotations

from argparse import ArgumentParser, Namespace
from pathlib import Path


def add_arguments(parser: ArgumentParser) -> None:
    """Arguments of ``motiondlo record``."""
    parser.add_argument("--config", type=Path, required=True, metavar="FILE", help="the running cell's configuration")
    parser.add_argument("--out", type=Path, required=True, metavar="DIR", help="the recording, a new folder")
    parser.add_argument("--seconds", type=float, metavar="S", help="stop after so long, instead of at Ctrl-C")
    parser.add_argument("--tracks", type=Path, metavar="FILE", help="write the cell's states here as tracks (.npz)")


def run(args: Namespace) -> int:
    """Record until told to stop."""
    import math
    import sys

    from motiondlo.cli.output import check_writable
    from motiondlo_services.record_run import record
    from motiondlo_services.runtime.shutdown import StopFlag

    def say(line: str) -> None:
        if not args.quiet:
            print(f"motiondlo record: {line}", file=sys.stderr, flush=True)  # noqa: T201

    if args.tracks is not None:
        check_writable(args.tracks)
    stop = StopFlag().install()
    limit_s = math.inf if args.seconds is None else args.seconds
    say(f"recording into {args.out}" + ("; Ctrl-C ends it" if args.seconds is None else ""))
    done = record(args.config, args.out, lambda seconds: bool(stop) or seconds >= limit_s, args.tracks)
    say(f"{done.seconds:.2f} s, {done.events} events in {done.batches} batches, {done.frames} frames")
    if done.lost_batches:
        say(f"{done.lost_batches} batches are missing: the cell was overloaded, or the disk too slow")
    if done.frames_left_out:
        say(f"{done.frames_left_out} frames were left out: from before the start, or more than could be encoded")
    for note in done.notes:
        say(note)
    return 0
