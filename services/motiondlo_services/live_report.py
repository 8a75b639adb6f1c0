"""Figures of a live run: a JSON document and a table."""

from __future__ import annotations

from typing import Any

import numpy as np

from motiondlo_services.live_run import LiveRun


def live_figures(run: LiveRun) -> dict[str, Any]:
    """``{"latency_ms": {"p50", "p99", "max"}, "states", "dropped_batches", "cpu": {daemon: cores}, ...}``."""
    latency: dict[str, float | None] = {"p50": None, "p99": None, "max": None}
    if run.latency_ns:
        ms = np.array(run.latency_ns, dtype=np.float64) / 1e6
        latency = {
            "p50": round(float(np.percentile(ms, 50)), 4),
            "p99": round(float(np.percentile(ms, 99)), 4),
            "max": round(float(ms.max()), 4),
        }
    segmenter = run.health.get("segmenter")
    return {
        "latency_ms": latency,
        "states": len(run.states),
        "published_batches": run.published_batches,
        "tracked_batches": run.tracked_batches,
        "published_states": run.published_states,
        "dropped_batches": run.dropped_batches,
        "merged_batches": run.merged_batches,
        "lost_states": run.lost_states,
        "cpu": {name: round(cores, 3) for name, cores in run.cpu.items()},
        "restarts": run.restarts,
        "segmentations": 0 if segmenter is None else int(segmenter.info.get("frames", 0)),
        "scheduling": {name: str(health.info.get("scheduling", "")) for name, health in run.health.items()},
    }


def print_live_figures(figures: dict[str, Any], title: str) -> None:
    """A table for a person."""
    from rich.console import Console
    from rich.table import Table

    table = Table(title=title, title_justify="left", show_header=False)
    latency = figures["latency_ms"]
    values = "none" if latency["p50"] is None else " / ".join(f"{latency[k]:.2f}" for k in ("p50", "p99", "max"))
    table.add_row("latency p50 / p99 / max, ms", values)
    batches = f"{figures['published_batches']} / {figures['tracked_batches']}"
    table.add_row("batches sent / tracked", batches)
    table.add_row("states sent / seen", f"{figures['published_states']} / {figures['states']}")
    table.add_row("batches dropped / merged", f"{figures['dropped_batches']} / {figures['merged_batches']}")
    table.add_row("segmentations", str(figures["segmentations"]))
    for name, cores in figures["cpu"].items():
        table.add_row(f"processor, {name}", f"{cores:.2f} cores ({figures['scheduling'].get(name, '')})")
    Console().print(table)
