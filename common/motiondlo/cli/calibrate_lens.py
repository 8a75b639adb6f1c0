"""Calibrate a camera's lens from pictures of a checkerboard or ChArUco board, or from a recording of one.

SOURCE is picture files, folders of them, or one recording (its frames; with --camera event, what its events show).
The board is flat and shown sharp, in every part of the image, tilted by 20 to 40 degrees to different sides.
"""

from __future__ import annotations

from argparse import ArgumentParser, Namespace
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from motiondlo.calibration.lens_fit import LensReport
    from motiondlo.calibration.lens_views import BoardViews


def add_arguments(parser: ArgumentParser) -> None:
    """Arguments of ``motiondlo calibrate lens``."""
    parser.add_argument("source", type=Path, nargs="+", metavar="SOURCE", help="pictures, folders, or a recording")
    parser.add_argument(
        "--board",
        default="checkerboard:9x6",
        metavar="KIND:CxR",
        help="checkerboard:9x6 (inner corners) or charuco:8x6 (squares; dictionary 4x4, 50 markers)",
    )
    parser.add_argument("--camera", choices=("rgb", "event"), default="rgb", help="of a recording (default rgb)")
    parser.add_argument("--out", type=Path, metavar="FILE", help="lens file (default lens.json in this folder)")
    parser.add_argument("--dry-run", action="store_true", help="report only, write no lens file")
    parser.add_argument("--picture", type=Path, metavar="FILE", help="write a picture of the residuals (.png)")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the report here")


def run(args: Namespace) -> int:
    """Find the board, fit, report, write."""
    from motiondlo.calibration.lens_fit import calibrate_lens
    from motiondlo.calibration.saving import save_lens
    from motiondlo.cli.output import check_writable, write_bytes, write_json

    out = args.out or Path("lens.json")
    for path in (args.picture, args.json, None if args.dry_run else out):
        if path is not None:
            check_writable(path)
    fit, report = calibrate_lens(_views(args))
    if args.picture is not None:
        from motiondlo.calibration.lens_picture import lens_picture

        write_bytes(args.picture, lens_picture(fit, report))
    if args.json is not None:
        write_json(args.json, report.as_dict())
    backup = None if args.dry_run else save_lens(out, fit.lens)
    if not args.quiet:
        _print(report, ", ".join(str(path) for path in args.source[:3]))
        if not args.dry_run:
            print(f"{out} written" + (f", the old one is {backup}" if backup is not None else ""))
    return 0


def _views(args: Namespace) -> BoardViews:
    from motiondlo.calibration.boards import parse_board
    from motiondlo.calibration.lens_views import views_of_pictures, views_of_recording
    from motiondlo.errors import CalibrationError
    from motiondlo.recording.layout import open_recording

    board = parse_board(args.board)
    first = args.source[0]
    if len(args.source) == 1 and (first / "manifest.json").is_file():
        return views_of_recording(open_recording(first), board, args.camera)
    if args.camera == "event":
        raise CalibrationError("--camera event: needs a recording.", "Record the board while it blinks or moves.")
    return views_of_pictures(args.source, board)


def _print(report: LensReport, title: str) -> None:
    from motiondlo.cli.tables import compact_table, console

    table = compact_table(f"{title}: lens")
    table.add_column("")
    table.add_column("")
    held_out = "" if report.held_out_px is None else f", {report.held_out_px:.2f} px on views held back"
    for name, value in (
        ("views used", f"{report.views} of {report.pictures} pictures, {report.corners} corners"),
        ("residuals", f"rms {report.rms_px:.2f}, p95 {report.p95_px:.2f} px{held_out}"),
        (
            "focal length",
            f"{report.focal_px[0]:.1f} and {report.focal_px[1]:.1f} px, standard deviation {report.focal_sigma_px:.1f}",
        ),
        ("corners cover", f"{100 * report.covered_share:.0f} % of the image"),
        ("board tilted", f"{report.tilt_deg:.0f} degrees between views at most"),
        ("the lens moves", f"a point of the image by up to {report.largest_shift_px:.1f} px"),
        *(("left out", name) for name in report.left_out),
        *(("warning", text) for text in report.warnings),
    ):
        table.add_row(name, value)
    console().print(table)
