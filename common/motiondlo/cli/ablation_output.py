"""The ablation's table for people."""

from __future__ import annotations

from typing import TYPE_CHECKING

from motiondlo.cli.tables import compact_table, console, figure

if TYPE_CHECKING:
    from motiondlo.offline.ablation import Ablation, Figures, Row

_CAPTION = (
    "means over the recordings and the DLOs that move, mm; delta: to the full tracker; earns: what point-to-curve and "
    "paired error grow by when it is taken out, and 5 mm for all the time lost; dim: takes no part here"
)


def print_ablation(ablation: Ablation) -> None:
    """Components by what they earn; with several recordings also what each earns there; default against paper."""
    names = ablation.recordings
    title = names[0] if len(names) == 1 else f"{len(names)} recordings"
    table = compact_table(f"{title}, {ablation.profile} profile, one component taken out at a time", _CAPTION)
    table.add_column("without", no_wrap=True)
    for heading in ("earns", "ptc", "delta", "paired", "delta", "lost", "sw", "NEES"):
        table.add_column(heading, justify="right", no_wrap=True)
    table.add_row("(nothing)", *_cells(ablation.full, ablation.full), style="bold")
    for row in ablation.rows:
        table.add_row(row.component.name, *_cells(row, ablation.full), style="dim" if row.mean.unchanged else "")
    console().print(table)
    if len(names) > 1:
        _print_by_recording(ablation)
    if ablation.other is not None:
        for k, name in enumerate(names):
            console().print(_against(name, ablation, k), highlight=False, soft_wrap=True)


def _cells(row: Row, full: Row) -> tuple[str, ...]:
    mean, whole = row.mean, full.mean
    return (
        "" if row is full else f"{row.earns_mm:+.3f}",
        figure(mean.ptc_mm, 3),
        "" if row is full else _delta(mean.ptc_mm, whole.ptc_mm),
        figure(mean.e_mm, 3),
        "" if row is full else _delta(mean.e_mm, whole.e_mm),
        f"{100 * mean.lost_fraction:.1f}%",
        str(mean.id_switches),
        figure(mean.nees, 1),
    )


def _delta(value: float | None, whole: float | None) -> str:
    return "-" if value is None or whole is None else f"{value - whole:+.3f}"


def _print_by_recording(ablation: Ablation) -> None:
    table = compact_table("what each earns, mm, by recording")
    table.add_column("without", no_wrap=True)
    for k, name in enumerate(ablation.recordings, start=1):
        console().print(f"{k}: {name}", highlight=False)
        table.add_column(str(k), justify="right", no_wrap=True)
    for row in ablation.rows:
        earned = zip(row.runs, ablation.full.runs, strict=True)
        cells = ("" if run.unchanged else f"{run.cost_mm - whole.cost_mm:+.2f}" for run, whole in earned)
        table.add_row(row.component.name, *cells)
    console().print(table)


def _against(name: str, ablation: Ablation, k: int) -> str:
    assert ablation.other is not None
    runs = {ablation.profile: ablation.full.runs[k], ablation.other.component.name: ablation.other.runs[k]}
    ours, paper = runs["default"], runs["paper"]
    better = "default" if ours.cost_mm < paper.cost_mm else "paper"
    return f"{name}: default against paper: {_pair(ours, paper)}: {better} is better"


def _pair(a: Figures, b: Figures) -> str:
    return (
        f"ptc {figure(a.ptc_mm, 2)} against {figure(b.ptc_mm, 2)} mm, "
        f"paired {figure(a.e_mm, 2)} against {figure(b.e_mm, 2)} mm, "
        f"lost {100 * a.lost_fraction:.1f} against {100 * b.lost_fraction:.1f} %, "
        f"switches {a.id_switches} against {b.id_switches}"
    )
