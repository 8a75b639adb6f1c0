"""Make a recording with exact truth from a scene file."""

from __future__ import annotations

from argparse import ArgumentParser, Namespace
from pathlib import Path


def add_arguments(parser: ArgumentParser) -> None:
    """Arguments of ``motiondlo simulate``."""
    parser.add_argument("scene", metavar="SCENE", help="name of a bundled scene, or a scene file (.toml)")
    parser.add_argument("--out", type=Path, required=True, metavar="DIR", help="write the recording to this new folder")
    parser.add_argument("--seed", type=int, default=1, help="draws all that the scene leaves open (default 1)")
    parser.add_argument("--speed", type=float, metavar="MM_S", help="mean speed of strokes, instead of the scene's")


def run(args: Namespace) -> int:
    """Simulate, write, say what came out."""
    from motiondlo.cli.progress import progress_bar
    from motiondlo.cli.tables import console
    from motiondlo.config.validation import validated
    from motiondlo.simulation.scene import SceneParams
    from motiondlo.simulation.scene_files import load_scene
    from motiondlo.simulation.simulate import simulate_recording

    name, scene = load_scene(args.scene)
    if args.speed is not None:
        scene = validated(SceneParams, {**scene.model_dump(), "speed_mm_s": args.speed}, "--speed")
    with progress_bar(f"simulating {name}", args.quiet) as progress:
        statistics = simulate_recording(name, scene, args.seed, args.out, progress)
    if not args.quiet:
        console().print(
            f"{args.out}: {statistics['duration_s']:.2f} s, {statistics['events']} events, "
            f"{statistics['moving_s']:.2f} s of motion.",
            highlight=False,
            soft_wrap=True,
        )
    return 0
