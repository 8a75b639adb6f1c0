"""The residuals of a homography as a picture: where the points are, and in which direction each is off."""

from __future__ import annotations

from io import BytesIO

import numpy as np

from motiondlo.calibration.homography_report import HomographyReport
from motiondlo.calibration.point_pairs import PointPairs
from motiondlo.drawing.palette import as_hex, colour_of
from motiondlo.geometry.homography_fit import HomographyFit


def residual_picture(
    pairs: PointPairs, fit: HomographyFit, report: HomographyReport, event_size_px: tuple[int, int]
) -> bytes:
    """PNG: event image with an arrow per pair (enlarged), refused pairs crossed out; beside it the residuals' cloud."""
    # Late: matplotlib costs about half a second, which only a picture should pay. No pyplot: it keeps global state.
    from matplotlib.figure import Figure

    used, off = as_hex(colour_of(0)), "0.45"
    width, height = event_size_px
    figure = Figure(figsize=(11.0, 4.2), dpi=110, layout="constrained")
    image, cloud = figure.subplots(1, 2, width_ratios=(2.2, 1))
    enlarge = 0.08 * width / max(report.p95_px, 1e-6)
    ok, x, r = fit.inliers, pairs.event_px, fit.forward_px
    arrows = enlarge * r[ok]
    image.quiver(*x[ok].T, *arrows.T, angles="xy", scale_units="xy", scale=1.0, color=used, width=0.003, label="used")
    image.scatter(*x[ok].T, s=12, color=used, zorder=3)
    if not ok.all():
        image.scatter(*x[~ok].T, s=50, marker="x", color=off, zorder=3, label="refused")
    image.set_xlim(0, width)
    image.set_ylim(height, 0)
    image.set_aspect("equal")
    image.set_xlabel("event x, px")
    image.set_ylabel("event y, px")
    image.set_title(f"residuals, {enlarge:.0f} times enlarged", fontsize=10)
    image.legend(loc="best", frameon=False, fontsize=8)
    cloud.scatter(*r[ok].T, s=16, color=used)
    limit = 1.15 * max(float(np.abs(r[ok]).max()), 1e-3)
    for radius, style in ((report.mean_px, "-"), (report.p95_px, "--")):
        angle = np.linspace(0, 2 * np.pi, 100)
        cloud.plot(radius * np.cos(angle), radius * np.sin(angle), style, color="0.6", linewidth=0.8)
    cloud.set_xlim(-limit, limit)
    cloud.set_ylim(limit, -limit)
    cloud.set_aspect("equal")
    cloud.set_xlabel("x, px")
    cloud.set_ylabel("y, px")
    cloud.set_title(
        f"{report.inliers} of {report.pairs}: mean {report.mean_px:.2f} px, p95 {report.p95_px:.2f} px", fontsize=10
    )
    png = BytesIO()
    figure.savefig(png, format="png")
    return png.getvalue()
