"""Arguments that every command that runs the offline loop understands."""

from __future__ import annotations

from argparse import ArgumentParser, ArgumentTypeError, Namespace, _ArgumentGroup
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from motiondlo.offline.options import TrackOptions

# Named here too, so that usage errors and --help need no heavy imports; a test holds them together.
PROFILES = ("default", "paper")
MODES = ("hybrid", "event", "frame")


def add_loop_arguments(parser: ArgumentParser | _ArgumentGroup) -> None:
    """``--mode --update-us --segmenter-latency-ms --set``."""
    parser.add_argument(
        "--mode",
        choices=MODES,
        default="hybrid",
        help="hybrid (default); event: no frames, no homography; frame: held shapes of frames only",
    )
    parser.add_argument(
        "--update-us",
        type=_update_us,
        default=2000,
        metavar="N",
        help="batch period in microseconds (default 2000)",
    )
    parser.add_argument(
        "--segmenter-latency-ms",
        type=_latency_ms,
        default=1000.0,
        metavar="MS",
        help="a segmentation arrives this long after it was asked for (default 1000); the first frame's is there at "
        "the start",
    )
    for camera in ("rgb", "event"):
        parser.add_argument(
            f"--{camera}-lens",
            type=Path,
            metavar="FILE",
            help=f"lens file of the {camera} camera; the homography then relates undistorted pixels",
        )
    parser.add_argument(
        "--set",
        action="append",
        default=[],
        dest="assignments",
        metavar="KEY=VALUE",
        help="change a parameter: tracker.x=..., fusion.x=..., frames.x=... (may be repeated)",
    )


def options_of(args: Namespace, profile: str) -> TrackOptions:
    """The options that the arguments say. Raises ConfigError for a wrong ``--set``."""
    from motiondlo.offline.options import TrackMode, TrackOptions, overrides_from

    overrides = overrides_from(args.assignments)
    return TrackOptions(
        profile=profile,
        mode=TrackMode(args.mode),
        update_us=args.update_us,
        segmenter_latency_ms=args.segmenter_latency_ms,
        rgb_lens=args.rgb_lens,
        event_lens=args.event_lens,
        tracker=overrides["tracker"],
        fusion=overrides["fusion"],
        frames=overrides["frames"],
    )


def _update_us(text: str) -> int:
    if not text.isdecimal() or not 100 <= int(text) <= 1_000_000:
        raise ArgumentTypeError(f"{text!r} is no whole number from 100 to 1000000")
    return int(text)


def _latency_ms(text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = -1.0
    if not 0.0 <= value <= 60_000.0:
        raise ArgumentTypeError(f"{text!r} is no number from 0 to 60000")
    return value
