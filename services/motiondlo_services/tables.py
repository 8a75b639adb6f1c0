"""The process table and the topic table as a page: ``python -m motiondlo_services.tables > docs/tables.md``."""

from __future__ import annotations

import sys

from motiondlo.topics import markdown_table
from motiondlo_services.processes import PROCESSES, Scheduling


def process_table() -> str:
    """One row a daemon, Markdown."""
    lines = [
        "| daemon | what it does | reads | writes | scheduling | watchdog | code | the paper's part |",
        "|---|---|---|---|---|---|---|---|",
    ]
    for row in PROCESSES:
        scheduling = f"FIFO {row.priority}" if row.scheduling == Scheduling.FIFO else f"normal, nice {row.nice}"
        scheduling += ", own processor" if row.own_processor else ""
        folder = row.module.rsplit(".", 1)[0].replace(".", "/")
        cells = (
            f"`{row.name}`",
            row.purpose,
            ", ".join(f"`{name}`" for name in row.reads),
            ", ".join(f"`{name}`" for name in row.writes),
            scheduling,
            f"{row.watchdog_s} s",
            f"[`{folder}`](../services/{folder})",
            row.paper,
        )
        lines.append(f"| {' | '.join(cells)} |")
    return "\n".join(lines) + "\n"


def page() -> str:
    """The whole page."""
    return (
        "# Processes and topics\n\n"
        "Written by `python -m motiondlo_services.tables > docs/tables.md` from the two tables of the code\n"
        "([processes.py](../services/motiondlo_services/processes.py), [topics.py](../common/motiondlo/topics.py)).\n"
        "A test fails when this page is not current.\n\n"
        f"## Processes\n\n{process_table()}\n"
        "## Topics\n\nKeys below `motiondlo/<cell>/`; the payloads are described in [schemas](schemas/README.md).\n\n"
        f"{markdown_table()}"
    )


if __name__ == "__main__":
    sys.stdout.write(page())
