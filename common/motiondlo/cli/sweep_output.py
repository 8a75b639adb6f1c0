"""The sweep's table for people."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from motiondlo.cli.tables import compact_table, console, figure

if TYPE_CHECKING:
    from motiondlo.offline.sweep import Fit, Point

_CAPTION = (
    "processor time of one core, virtual arrival times; update and latency: p50, p99, max; load: processor seconds per "
    "second of events; stages: ms per batch; backlog: most batches waiting, and when the last one came; error: mean px"
)


def print_sweep(profile: str, points: Sequence[Point], fit: Fit | None) -> None:
    """One row a scene, then how the load grows."""
    table = compact_table(f"sweep, {profile} profile", _CAPTION)
    for heading in (
        "DLOs", "Mev/s", "update ms", "load", "decode", "track", "publ.", "latency ms", "backlog", "dropped", "error",
    ):  # fmt: skip
        table.add_column(heading, justify="right", no_wrap=True)
    for point in points:
        entry = point.as_json()
        stages = dict(entry["stages_ms"])
        decode = stages.pop("decode", 0.0)
        publication = stages.pop("publication", 0.0) + stages.pop("fusion", 0.0)
        table.add_row(
            str(point.dlos),
            f"{point.events / point.seconds / 1e6:.0f}",
            _percentiles(entry["update_ms"], 1),
            f"{point.load:.2f}",
            f"{decode:.2f}",
            f"{sum(stages.values()):.2f}",
            f"{publication:.2f}",
            _percentiles(entry["latency_ms"], 0),
            f"{point.backlog_most} {point.backlog_end}",
            f"{100 * point.dropped_events / max(point.events, 1):.0f}%",
            figure(entry["error_px"]["mean"], 2),
        )
    console().print(table)
    if fit is not None:
        console().print(
            f"load = {fit.fixed:.3f} + {fit.per_mev:.4f} per Mev/s + {fit.per_dlo:.3f} per DLO, R2 {fit.r2:.3f} "
            f"({fit.points} scenes without drops)",
            highlight=False,
        )
    slowest = min(point.decode_surface_hz for point in points)
    console().print(f"decoding and surface alone: at least {slowest / 1e6:.0f} Mev/s on one core", highlight=False)


def _percentiles(values: dict[str, float | None], digits: int) -> str:
    return " ".join(figure(value, digits) for value in values.values())
