"""Follow the DLOs through a recording with the cores that the daemons run: deterministic, causal, as fast as it can."""

from __future__ import annotations

from argparse import ArgumentParser, Namespace
from pathlib import Path

from motiondlo.cli.track_arguments import PROFILES, add_loop_arguments, options_of

# Named here too, so that --help needs no heavy imports; a test holds them together.
WRONG_SHAPES = ("mirrored", "shifted", "merged", "swapped", "shortened", "extra")


def add_arguments(parser: ArgumentParser) -> None:
    """Arguments of ``motiondlo track``."""
    parser.add_argument("recording", type=Path, metavar="RECORDING", help="folder with events.raw")
    parser.add_argument("--out", type=Path, required=True, metavar="FILE", help="write the tracks here (.npz)")
    parser.add_argument(
        "--profile", choices=PROFILES, default="default", help="tracker: ours (default), or the paper's"
    )
    add_loop_arguments(parser)
    parser.add_argument(
        "--work-plane", type=Path, metavar="FILE", help="plane file: the tracks hold nodes_mm (T, M, 2) as well"
    )
    debugging = parser.add_argument_group("debugging")
    debugging.add_argument(
        "--wrong-segmentation",
        choices=WRONG_SHAPES,
        help="make every shape after the first frame's wrong, to see what becomes of the tracks",
    )


def run(args: Namespace) -> int:
    """Track, write, say how it went."""
    from time import perf_counter

    from motiondlo.cli.output import check_writable
    from motiondlo.cli.progress import progress_bar
    from motiondlo.cli.tables import console
    from motiondlo.geometry.lens import load_lens
    from motiondlo.geometry.work_plane import load_work_plane
    from motiondlo.offline.run_track import prepare, rows_of
    from motiondlo.offline.wrong_segmentation import WrongShape, with_wrong_shapes
    from motiondlo.recording.layout import open_recording

    check_writable(args.out)
    work_plane = None
    if args.work_plane is not None:
        event_lens = None if args.event_lens is None else load_lens(args.event_lens)
        work_plane = load_work_plane(args.work_plane, event_lens)
    recording = open_recording(args.recording)
    changed = None
    if args.wrong_segmentation:
        info = recording.camera_info
        changed = with_wrong_shapes(WrongShape(args.wrong_segmentation), info.px_per_mm)
    track_run = prepare(recording, options_of(args, args.profile), changed)
    began = perf_counter()
    with progress_bar(f"tracking {recording.name}", args.quiet) as progress:
        tracks = rows_of(track_run.states(progress))
    elapsed_s = perf_counter() - began
    tracks.save(args.out, work_plane)
    if not args.quiet:
        console().print(
            f"{args.out}: {_counted(len(tracks), 'estimate')} of {_counted(len(tracks.known_ids()), 'DLO')} in "
            f"{_counted(track_run.updates, 'update')}, {_counted(track_run.loop.segmented, 'frame')} segmented, "
            f"{elapsed_s:.1f} s.",
            highlight=False,
            soft_wrap=True,
        )
        for note in track_run.notes():
            console().print(note, highlight=False, soft_wrap=True)
    return 0


def _counted(n: int, what: str) -> str:
    return f"{n} {what}" if n == 1 else f"{n} {what}s"
