"""Time of a segmenter backend per stage on this machine; SAM 3 also with random weights, as fast as real ones."""

from __future__ import annotations

from argparse import ArgumentParser, ArgumentTypeError, Namespace
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from rich.table import Table

    from motiondlo.offline.segmenter_bench import BackendTiming


def add_arguments(parser: ArgumentParser) -> None:
    """Arguments of ``motiondlo bench segmenter``."""
    parser.add_argument(
        "source", type=Path, nargs="?", metavar="PICTURE", help="a picture or a recording (default: the bundled one)"
    )
    parser.add_argument(
        "--backend", default="classical", metavar="NAME", help="classical (default), sam3, onnx, replay"
    )
    parser.add_argument(
        "--random-weights",
        nargs="?",
        const="full",
        choices=("full", "tiny"),
        help="SAM 3 of this size without its weights: full (default) or tiny",
    )
    parser.add_argument("--width-px", type=_count, metavar="N", help="bring the picture to this width, e.g. 2592")
    parser.add_argument("--repeats", type=_count, default=10, metavar="N", help="frames to time (default 10)")
    parser.add_argument(
        "--set",
        action="append",
        default=[],
        dest="assignments",
        metavar="KEY=VALUE",
        help="change a parameter: frames.sam3.device=cuda, frames.onnx.model=FILE ... (may be repeated)",
    )
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the figures here")


def run(args: Namespace) -> int:
    """Load, time, print, write."""
    from motiondlo.bundled import bundled_recording
    from motiondlo.cli.output import check_writable, write_json
    from motiondlo.cli.progress import progress_bar
    from motiondlo.cli.tables import console
    from motiondlo.config.validation import validated
    from motiondlo.frames.params import FrameParams
    from motiondlo.offline.machine import machine_facts
    from motiondlo.offline.options import overrides_from
    from motiondlo.offline.segmenter_bench import picture, time_backend

    if args.json is not None:
        check_writable(args.json)
    params = validated(FrameParams, {"backend": args.backend} | overrides_from(args.assignments)["frames"], "frames")
    image, background = picture(args.source or bundled_recording(), args.width_px)
    facts = machine_facts()
    with progress_bar(f"timing {args.backend}", args.quiet) as progress:
        timing = time_backend(params, image, background, args.repeats, args.random_weights, progress)
    if args.json is not None:
        write_json(args.json, {"machine": facts, **timing.as_json()})
    if not args.quiet:
        console().print(_table(timing))
        console().print(
            f"{facts['cpu']}, {facts['cores']} cores, load {facts['load_1min']}", highlight=False, soft_wrap=True
        )
    return 0


def _table(timing: BackendTiming) -> Table:
    from motiondlo.cli.tables import compact_table, figure

    figures = timing.as_json()
    width, height = timing.image_px
    table = compact_table(
        f"{timing.backend} on {timing.runs_on}, {width}x{height}: ms per frame",
        f"{timing.outcome}; loaded in {timing.load_s:.1f} s, first frame {timing.first_ms:.0f} ms",
    )
    for heading in ("", "p50", "max"):
        table.add_column(heading, justify="right" if heading else "left", no_wrap=True)
    rows = {"frame": figures["total_ms"], **{f"  {name}": values for name, values in figures["stages_ms"].items()}}
    for name, values in rows.items():
        style = "bold" if name == "frame" else ""
        table.add_row(name, figure(values["p50"], 2), figure(values["max"], 2), style=style)
    return table


def _count(text: str) -> int:
    if not text.isdecimal() or not 1 <= int(text) <= 16384:
        raise ArgumentTypeError(f"{text!r} is no whole number from 1 to 16384")
    return int(text)
