"""Errors of one DLO over time as a plot."""

from __future__ import annotations

from io import BytesIO

import numpy as np
import numpy.typing as npt

from motiondlo.drawing.palette import as_hex, colour_of
from motiondlo.offline.evaluation import Verdict
from motiondlo.offline.ground_truth import GroundTruth

_LOST_MM = 5.0


def error_plot(verdict: Verdict, truth: GroundTruth) -> bytes:
    """PNG: point-to-curve, paired and coverage error over time, above the speed; grey where the DLO is not judged."""
    # Late: matplotlib costs about half a second, which only this plot should pay. No pyplot: it keeps global state.
    from matplotlib.figure import Figure

    figure = Figure(figsize=(10.0, 4.2), dpi=110, layout="constrained")
    errors_axes, speed_axes = figure.subplots(2, 1, sharex=True, height_ratios=(3, 1))
    if verdict.errors is not None:
        t_s = verdict.errors.times_us / 1e6
        for values, name, colour_id in (
            (verdict.errors.e_mm, "paired", 1),
            (verdict.errors.cov_mm, "cov", 2),
            (verdict.errors.ptc_mm, "ptc", 0),
        ):
            errors_axes.plot(t_s, values, label=name, color=as_hex(colour_of(colour_id)), linewidth=1.2)
        largest = [_largest(values) for values in (verdict.errors.e_mm, verdict.errors.cov_mm, verdict.errors.ptc_mm)]
        # A lost track would squeeze everything else to the axis.
        errors_axes.set_ylim(0.0, min(max(1.05 * max(largest), 0.5), 4.0 * _LOST_MM))
        if max(largest) > _LOST_MM:
            errors_axes.axhline(_LOST_MM, color="0.4", linewidth=0.8, linestyle="--", label="lost")
        errors_axes.legend(loc="upper right", ncols=4, frameon=False)
    else:
        errors_axes.text(0.5, 0.5, "no estimate", ha="center", va="center", transform=errors_axes.transAxes)
    errors_axes.set_ylabel("error, mm")
    speed_axes.plot(truth.times_us / 1e6, truth.speed_mm_s[verdict.dlo], color="0.25", linewidth=1.0)
    speed_axes.set_ylabel("mm/s")
    speed_axes.set_xlabel("time, s")
    for axes in (errors_axes, speed_axes):
        for start_s, end_s in _spans(~truth.judged(verdict.dlo), truth.times_us / 1e6):
            axes.axvspan(start_s, end_s, color="0.92", linewidth=0)
        axes.spines[["top", "right"]].set_visible(False)
    speed_axes.set_xlim(truth.times_us[0] / 1e6, truth.times_us[-1] / 1e6)
    png = BytesIO()
    figure.savefig(png, format="png")
    return png.getvalue()


def _largest(values: npt.NDArray[np.float64]) -> float:
    finite = values[np.isfinite(values)]
    return float(finite.max()) if len(finite) else 0.0


def _spans(mask: npt.NDArray[np.bool_], t_s: npt.NDArray[np.float64]) -> list[tuple[float, float]]:
    """(start, end) of every run of True."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], mask.astype(np.int8), [0]])))
    return [(float(t_s[a]), float(t_s[b - 1])) for a, b in edges.reshape(-1, 2)]
