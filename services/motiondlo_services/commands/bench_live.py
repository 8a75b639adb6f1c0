"""Play a recording in real time through the real daemons; latency as a subscriber sees it, drops, processor time."""

from __future__ import annotations

from argparse import ArgumentParser, Namespace
from pathlib import Path


def add_arguments(parser: ArgumentParser) -> None:
    """Arguments of ``motiondlo bench live``."""
    parser.add_argument("recording", type=Path, metavar="RECORDING", help="the recording to play")
    parser.add_argument("--segmenter-load", action="store_true", help="keep the segmenter busy all the time")
    parser.add_argument("--profile", default="default", help="the tracker's profile")
    parser.add_argument("--update-us", type=int, default=None, metavar="US", help="length of a batch, event time")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the figures here")


def run(args: Namespace) -> int:
    """Play, print, write."""
    import tempfile

    from motiondlo.cli.output import check_writable, write_json
    from motiondlo_services.live_report import live_figures, print_live_figures
    from motiondlo_services.live_run import play
    from motiondlo_services.replay_cell import write_replay_cell

    if args.json is not None:
        check_writable(args.json)
    with tempfile.TemporaryDirectory(prefix="motiondlo-") as folder:
        config = write_replay_cell(Path(folder) / "cell.toml", args.recording, sections=_sections(args))
        result = play(config, segmenter_load=args.segmenter_load)
    figures = live_figures(result)
    if args.json is not None:
        write_json(args.json, figures)
    if not args.quiet:
        print_live_figures(figures, title=f"{args.recording.resolve().name}, live")
    return 0


def _sections(args: Namespace) -> dict[str, dict[str, bool | int | float | str]]:
    sections: dict[str, dict[str, bool | int | float | str]] = {"event_tracker": {"profile": args.profile}}
    if args.update_us is not None:
        sections["event_ingest"] = {"batch_us": args.update_us}
    return sections
