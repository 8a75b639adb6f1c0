"""Errors of tracks against a recording's ground_truth.npz: a table, and on request JSON and a page with plots."""

from __future__ import annotations

from argparse import ArgumentParser, Namespace
from pathlib import Path


def add_arguments(parser: ArgumentParser) -> None:
    """Arguments of ``motiondlo eval``."""
    parser.add_argument("recording", type=Path, metavar="RECORDING", help="folder with ground_truth.npz")
    parser.add_argument("--tracks", type=Path, required=True, metavar="FILE", help="tracks.npz to judge")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the figures here")
    parser.add_argument("--html", type=Path, metavar="FILE", help="write a self-contained page with plots here")


def run(args: Namespace) -> int:
    """Evaluate, print, write."""
    from motiondlo.cli.output import check_writable, write_json, write_text
    from motiondlo.cli.tables import print_evaluation
    from motiondlo.offline.evaluation import evaluate
    from motiondlo.offline.ground_truth import load_ground_truth
    from motiondlo.offline.tracks import load_tracks

    for path in (args.json, args.html):
        if path is not None:
            check_writable(path)
    truth = load_ground_truth(args.recording / "ground_truth.npz")
    tracks = load_tracks(args.tracks)
    evaluation = evaluate(tracks, truth)
    if args.json is not None:
        write_json(args.json, evaluation.as_json())
    if args.html is not None:
        from motiondlo.offline.evaluation_page import evaluation_page

        write_text(args.html, evaluation_page(args.recording, tracks, truth, evaluation))
    if not args.quiet:
        print_evaluation(evaluation, title=args.recording.resolve().name)
    return 0
