"""Tables for people."""

from __future__ import annotations

import sys

from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.table import Table

from motiondlo.offline.evaluation import Evaluation, Summary, Verdict

_PIPED_WIDTH = 110


def console() -> Console:
    """Standard output, wide enough for a table where it is no terminal."""
    return Console(width=None if sys.stdout.isatty() else _PIPED_WIDTH)


def compact_table(title: str, caption: str = "") -> Table:
    """A table without frame, that fits 80 columns with about ten figures a row."""
    return Table(
        title=title,
        caption=caption or None,
        box=SIMPLE_HEAD,
        title_justify="left",
        caption_justify="left",
        pad_edge=False,
        collapse_padding=True,
    )


def print_evaluation(evaluation: Evaluation, title: str) -> None:
    """Print the verdict on every DLO: what moves first, then what never does."""
    table = compact_table(title, "errors in mm; ptc: mean, median, 95th percentile; dim: never moves")
    table.add_column("DLO", no_wrap=True)
    for heading in ("id", "ptc", "paired", "cov", "lost", "sw", "lag ms", "Hz", "NEES", "along"):
        table.add_column(heading, justify="right", no_wrap=True)
    for verdict in evaluation.moved:
        table.add_row(*_cells(verdict))
    if evaluation.moved and evaluation.static:
        table.add_section()
    for verdict in evaluation.static:
        table.add_row(*_cells(verdict), style="dim")
    console().print(table)
    if evaluation.calibration is not None:
        console().print(evaluation.calibration.summary(), highlight=False, soft_wrap=True)
    if evaluation.unmatched_ids:
        ids = ", ".join(str(i) for i in evaluation.unmatched_ids)
        console().print(f"ids that match no DLO: {ids}")


def _cells(verdict: Verdict) -> tuple[str, ...]:
    return (
        verdict.name,
        "-" if verdict.id is None else str(verdict.id),
        _summary(verdict.ptc_mm),
        figure(verdict.e_mm.mean, 2),
        figure(verdict.cov_mm.mean, 2),
        f"{100 * verdict.lost_fraction:.1f}%",
        str(verdict.id_switches),
        figure(verdict.lag_ms, 1),
        f"{verdict.rate_hz:.0f}",
        figure(verdict.nees, 1),
        figure(verdict.nees_tangent, 1),
    )


def _summary(summary: Summary) -> str:
    return " ".join(figure(value, 2) for value in (summary.mean, summary.median, summary.p95))


def figure(value: float | None, digits: int) -> str:
    """A number, or a dash where there is none."""
    return "-" if value is None else f"{value:.{digits}f}"
