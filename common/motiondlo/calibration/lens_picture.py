"""A calibrated lens as a picture: the corners with their residuals, and what the lens does to the image."""

from __future__ import annotations

from io import BytesIO

import numpy as np

from motiondlo.calibration.lens_fit import LensFit, LensReport
from motiondlo.drawing.palette import as_hex, colour_of


def lens_picture(fit: LensFit, report: LensReport) -> bytes:
    """PNG: an arrow per corner (enlarged), beside it how far the lens moves each place of the image."""
    # Late: matplotlib costs about half a second, which only a picture should pay. No pyplot: it keeps global state.
    from matplotlib.figure import Figure

    width, height = fit.lens.size_px
    figure = Figure(figsize=(11.0, 4.2), dpi=110, layout="constrained")
    corners, shifts = figure.subplots(1, 2)
    points = np.concatenate([view.image_points for view in fit.used])
    arrows = np.concatenate(fit.residuals_px)
    enlarge = 0.05 * width / max(report.p95_px, 1e-6)
    corners.quiver(
        *points.T,
        *(enlarge * arrows).T,
        angles="xy",
        scale_units="xy",
        scale=1.0,
        color=as_hex(colour_of(0)),
        width=0.002,
    )
    corners.set_title(
        f"{report.corners} corners, rms {report.rms_px:.2f} px; residuals {enlarge:.0f} times enlarged", fontsize=10
    )
    x, y = np.meshgrid(np.linspace(0, width - 1, 41), np.linspace(0, height - 1, 31))
    places = np.stack([x.ravel(), y.ravel()], axis=1)
    moved = places - fit.lens.undistorted(places)
    levels = shifts.contourf(x, y, np.hypot(*moved.T).reshape(x.shape), levels=12, cmap="cividis")
    figure.colorbar(levels, ax=shifts, label="px")
    shifts.set_title("how far the lens moves a place", fontsize=10)
    for axes in (corners, shifts):
        axes.set_xlim(0, width)
        axes.set_ylim(height, 0)
        axes.set_aspect("equal")
        axes.set_xlabel("x, px")
        axes.set_ylabel("y, px")
    png = BytesIO()
    figure.savefig(png, format="png")
    return png.getvalue()
