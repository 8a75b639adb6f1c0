"""Calibrate the homography from RGB to event pixels: from point pairs, a board, or the recording's moving cables.

POINTS is a .npz file (rgb_px, event_px: N x 2) or a .csv file (columns rgb_x, rgb_y, event_x, event_y). For a recording
its homography/calibration_points.npz is used, or what --from says. The result goes to rgb_to_event_H.npy beside the
points (for a recording: in its homography folder); an older one is kept as rgb_to_event_H.npy.bak.
"""

from __future__ import annotations

from argparse import ArgumentParser, Namespace
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from motiondlo.calibration.homography_report import HomographyReport

POINTS_FILE = Path("homography") / "calibration_points.npz"


def add_arguments(parser: ArgumentParser) -> None:
    """Arguments of ``motiondlo calibrate homography``."""
    parser.add_argument("source", type=Path, metavar="POINTS_OR_RECORDING", help="file of point pairs, or a recording")
    parser.add_argument(
        "--from",
        dest="method",
        choices=("points", "board", "cable"),
        help="for a recording: its point pairs (default), a board seen by both cameras, or its moving cables",
    )
    parser.add_argument(
        "--board",
        default="checkerboard:9x6",
        metavar="KIND:CxR",
        help="with --from board: checkerboard:9x6 (inner corners) or charuco:8x6 (squares; dictionary 4x4, 50 markers)",
    )
    parser.add_argument("--max-error-px", type=_positive, default=5.0, help="pairs further off are wrong (default 5)")
    parser.add_argument("--out", type=Path, metavar="FILE", help="write the matrix here instead")
    parser.add_argument("--dry-run", action="store_true", help="report only, write no matrix")
    parser.add_argument("--picture", type=Path, metavar="FILE", help="write a picture of the residuals (.png)")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the report here")


def _positive(text: str) -> float:
    value = float(text)
    if not 0.0 < value < 1e4:
        raise ValueError(text)
    return value


def run(args: Namespace) -> int:
    """Gather pairs, fit, report, write."""
    from motiondlo.calibration.homography_report import calibrate_homography
    from motiondlo.calibration.point_pairs import load_point_pairs
    from motiondlo.calibration.saving import save_homography
    from motiondlo.cli.output import check_writable, write_bytes, write_json

    for path in (args.picture, args.json):
        if path is not None:
            check_writable(path)
    size = _event_size(args.source)
    if args.source.is_dir() and args.method == "cable":
        return _from_cables(args)
    if args.source.is_dir() and args.method == "board":
        from motiondlo.calibration.board_recording import board_pairs
        from motiondlo.calibration.boards import parse_board
        from motiondlo.recording.layout import open_recording

        pairs = board_pairs(open_recording(args.source), parse_board(args.board))
    else:
        pairs = load_point_pairs(args.source / POINTS_FILE if args.source.is_dir() else args.source)
    fit, report = calibrate_homography(pairs, size, args.max_error_px)
    if args.picture is not None:
        from motiondlo.calibration.residual_picture import residual_picture

        write_bytes(args.picture, residual_picture(pairs, fit, report, size))
    if args.json is not None:
        write_json(args.json, report.as_dict() | {"event_from_rgb": fit.target_from_source.tolist()})
    out = _out(args)
    backup = None if args.dry_run else save_homography(out, fit.target_from_source)
    if not args.quiet:
        _print(report, str(args.source))
        if not args.dry_run:
            print(f"{out} written" + (f", the old one is {backup}" if backup is not None else ""))
    return 0


def _from_cables(args: Namespace) -> int:
    from motiondlo.calibration.moving_cable import refine_from_cables
    from motiondlo.calibration.saving import save_homography
    from motiondlo.errors import CalibrationError
    from motiondlo.recording.layout import open_recording

    outcome = refine_from_cables(open_recording(args.source))
    if not outcome.accepted:
        raise CalibrationError(
            f"{args.source}: the moving cables give no better homography ({outcome.reason}; {outcome.pairs} pairs).",
            "Keep the one in use, or calibrate from points or a board.",
        )
    out = _out(args)
    backup = None if args.dry_run else save_homography(out, outcome.event_from_rgb)
    if not args.quiet:
        print(
            f"{outcome.pairs} pairs of curves; distance of those held back {outcome.before_px:.2f} -> "
            f"{outcome.after_px:.2f} px; moved by {outcome.shift_px:.2f} px at most. "
            "Cables lie a few mm above the work plane, which shifts them: a board or points are more exact."
        )
        if not args.dry_run:
            print(f"{out} written" + (f", the old one is {backup}" if backup is not None else ""))
    return 0


def _out(args: Namespace) -> Path:
    if args.out is not None:
        return Path(args.out)
    folder = args.source / "homography" if args.source.is_dir() else args.source.parent
    return Path(folder / "rgb_to_event_H.npy")


def _event_size(source: Path) -> tuple[int, int]:
    """Size of the event image as the recording around the points knows it, 1280 x 720 otherwise."""
    from motiondlo.errors import RecordingError
    from motiondlo.recording.layout import open_recording

    for folder in (source, source.parent.parent):
        try:
            size = open_recording(folder).camera_info.event
        except RecordingError:
            continue
        if size is not None:
            return size.width, size.height
    return 1280, 720


def _print(report: HomographyReport, title: str) -> None:
    from motiondlo.cli.tables import compact_table, console

    table = compact_table(f"{title}: homography from RGB to event pixels")
    table.add_column("")
    table.add_column("")
    for name, value in (
        ("pairs used", f"{report.inliers} of {report.pairs}"),
        (
            "symmetric transfer error",
            f"mean {report.mean_px:.2f}, p95 {report.p95_px:.2f}, max {report.largest_px:.2f} px",
        ),
        ("noise of a point", f"{report.sigma_px:.2f} px" + (", heavy tails" if report.heavy_tailed else "")),
        ("points cover", f"{100 * report.covered_share:.0f} % of the event image"),
        (
            "expected error of the map",
            f"{report.expected_px:.2f} px, {report.expected_worst_px:.2f} px at the worst place",
        ),
        *(("warning", text) for text in report.warnings),
    ):
        table.add_row(name, value)
    console().print(table)
