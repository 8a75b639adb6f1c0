"""Play the bundled recording through all the real daemons; ends with a table and a picture."""

from __future__ import annotations

from argparse import ArgumentParser, Namespace
from pathlib import Path


def add_arguments(parser: ArgumentParser) -> None:
    """Arguments of ``motiondlo demo``."""
    parser.add_argument(
        "--out", type=Path, default=Path("motiondlo-demo"), metavar="DIR", help="tracks, figures and picture go here"
    )
    parser.add_argument("--recording", type=Path, metavar="DIR", help="play this recording instead of the bundled one")


def run(args: Namespace) -> int:
    """Play, judge, draw."""
    from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

    from motiondlo.bundled import bundled_recording
    from motiondlo.cli.output import write_json
    from motiondlo.cli.tables import console, print_evaluation
    from motiondlo.drawing.overlay import write_png
    from motiondlo.errors import MotionDLOError
    from motiondlo.offline.evaluation import evaluate
    from motiondlo.offline.ground_truth import load_ground_truth
    from motiondlo.recording.layout import open_recording
    from motiondlo_services.cell_config import bus_section
    from motiondlo_services.demo_picture import demo_picture
    from motiondlo_services.live_report import live_figures, print_live_figures
    from motiondlo_services.live_run import LiveRun, play
    from motiondlo_services.live_tracks import tracks_of
    from motiondlo_services.processes import PROCESSES
    from motiondlo_services.replay_cell import write_replay_cell
    from motiondlo_services.supervisor import Supervisor

    recording = open_recording(args.recording or bundled_recording())
    out: Path = args.out
    try:
        out.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise MotionDLOError(
            f"{out}: cannot be made ({error.strerror}).", "Choose another folder with --out."
        ) from error
    config = write_replay_cell(out / "cell.toml", recording.path, name="demo")
    end_us = max((entry.t_us for entry in recording.frames), default=1_000_000) + 50_000
    screen = console()
    if not args.quiet:
        endpoint = bus_section(config).all_endpoints()["fusion"]
        screen.print(f"Playing {recording.name} through {', '.join(row.name for row in PROCESSES)}.")
        screen.print(f"Subscribe to motiondlo/demo/state at {endpoint} while it runs.")
    with Progress(
        TextColumn("{task.description}"), BarColumn(), TimeElapsedColumn(), console=screen, disable=args.quiet
    ) as bar:
        task = bar.add_task("starting the daemons", total=end_us)

        def show(supervisor: Supervisor, run: LiveRun) -> None:
            """Some 50 times a second; drawing for every state would hold up the next one."""
            if run.states:
                state = run.states[-1]
                shown = f"{state.mode:<8} {len(state.dlos)} DLO"
                bar.update(task, completed=min(state.t_us, end_us), description=shown)

        result = play(config, on_step=show)
    tracks = tracks_of(result.states)
    tracks.save(out / "tracks.npz")
    figures = live_figures(result)
    write_json(out / "live.json", figures)
    write_png(out / "picture.png", demo_picture(recording, result.states))
    if recording.ground_truth_path.is_file():
        evaluation = evaluate(tracks, load_ground_truth(recording.ground_truth_path))
        write_json(out / "eval.json", evaluation.as_json())
        if not args.quiet:
            print_evaluation(evaluation, title="accuracy against the ground truth")
    if not args.quiet:
        print_live_figures(figures, title="the cell, as a subscriber saw it")
        screen.print(f"Picture: {out / 'picture.png'}   Tracks: {out / 'tracks.npz'}")
    return 0
