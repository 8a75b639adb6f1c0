"""Errors of tracks against a recording's ground_truth.npz: a table, and on request JSON and a page with plots.

With --ablate the recordings are tracked here, in full and with one ingredient of the tracker taken out at a time.
"""

from __future__ import annotations

from argparse import ArgumentParser, ArgumentTypeError, Namespace
from pathlib import Path

from motiondlo.cli.track_arguments import PROFILES, add_loop_arguments, options_of
from motiondlo.errors import MotionDLOError


def add_arguments(parser: ArgumentParser) -> None:
    """Arguments of ``motiondlo eval``."""
    parser.add_argument("recording", type=Path, nargs="+", metavar="RECORDING", help="folder with ground_truth.npz")
    what = parser.add_mutually_exclusive_group(required=True)
    what.add_argument("--tracks", type=Path, metavar="FILE", help="tracks.npz to judge")
    what.add_argument("--ablate", action="store_true", help="track without each component in turn: what does it earn?")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the figures here")
    parser.add_argument("--html", type=Path, metavar="FILE", help="with --tracks: a self-contained page with plots")
    ablation = parser.add_argument_group("with --ablate")
    ablation.add_argument("--profile", choices=PROFILES, default="default", help="whose components (default: default)")
    ablation.add_argument("--jobs", type=_jobs, default=1, metavar="N", help="recordings at once (default 1)")
    add_loop_arguments(ablation)


def run(args: Namespace) -> int:
    """Evaluate, print, write."""
    from motiondlo.cli.output import check_writable

    for path in (args.json, args.html):
        if path is not None:
            check_writable(path)
    if args.ablate:
        return _ablate(args)
    if len(args.recording) > 1:
        raise MotionDLOError("--tracks is of one recording, and several are named.", "Name one RECORDING.")
    return _evaluate(args, args.recording[0])


def _evaluate(args: Namespace, recording: Path) -> int:
    from motiondlo.cli.output import write_json, write_text
    from motiondlo.cli.tables import print_evaluation
    from motiondlo.offline.evaluation import evaluate
    from motiondlo.offline.ground_truth import load_ground_truth
    from motiondlo.offline.tracks import load_tracks

    truth = load_ground_truth(recording / "ground_truth.npz")
    tracks = load_tracks(args.tracks)
    evaluation = evaluate(tracks, truth)
    if args.json is not None:
        write_json(args.json, evaluation.as_json())
    if args.html is not None:
        from motiondlo.offline.evaluation_page import evaluation_page

        write_text(args.html, evaluation_page(recording, tracks, truth, evaluation))
    if not args.quiet:
        print_evaluation(evaluation, title=recording.resolve().name)
    return 0


def _ablate(args: Namespace) -> int:
    from motiondlo.cli.ablation_output import print_ablation
    from motiondlo.cli.output import write_json
    from motiondlo.cli.progress import progress_bar
    from motiondlo.offline.ablation import ablate
    from motiondlo.recording.layout import open_recording

    if args.html is not None:
        raise MotionDLOError("--html shows tracks, and --ablate has none.", "Leave out one of them.")
    recordings = [open_recording(path) for path in args.recording]
    with progress_bar(f"ablation of {args.profile}", args.quiet) as progress:
        ablation = ablate(recordings, options_of(args, args.profile), args.jobs, progress)
    if args.json is not None:
        write_json(args.json, ablation.as_json())
    if not args.quiet:
        print_ablation(ablation)
    return 0


def _jobs(text: str) -> int:
    if not text.isdecimal() or not 1 <= int(text) <= 256:
        raise ArgumentTypeError(f"{text!r} is no whole number from 1 to 256")
    return int(text)
