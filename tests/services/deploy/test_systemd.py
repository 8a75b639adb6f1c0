"""The systemd units: valid, and in step with the process table."""

from __future__ import annotations

import configparser
import shutil
import subprocess
from pathlib import Path

import pytest

from motiondlo_services.processes import PROCESSES, Process, Scheduling

UNITS = Path(__file__).resolve().parents[3] / "deploy" / "systemd"


def read_unit(path: Path) -> configparser.ConfigParser:
    unit = configparser.ConfigParser(strict=False, interpolation=None)
    unit.optionxform = str  # type: ignore[assignment,method-assign]
    unit.read(path)
    return unit


def unit_names() -> list[str]:
    """One per process, and one more for each that has another to stand by."""
    working = [f"motiondlo-{row.name}.service" for row in PROCESSES]
    return working + [f"motiondlo-{row.name}-standby.service" for row in PROCESSES if row.standby]


def test_there_is_one_unit_per_process_and_no_other() -> None:
    assert {p.name for p in UNITS.glob("*.service")} == set(unit_names())


@pytest.mark.parametrize("row", [row for row in PROCESSES if row.standby], ids=lambda row: row.name)
def test_who_stands_by_is_run_like_who_works(row: Process) -> None:
    working, standing_by = (read_unit(UNITS / f"motiondlo-{row.name}{tail}.service") for tail in ("", "-standby"))
    assert dict(standing_by["Service"]) == dict(working["Service"])
    assert dict(standing_by["Install"]) == dict(working["Install"])


@pytest.mark.parametrize("row", PROCESSES, ids=lambda row: row.name)
def test_unit_follows_its_row(row: Process) -> None:
    service = read_unit(UNITS / f"motiondlo-{row.name}.service")["Service"]
    assert service["Type"] == "notify"
    assert service["Restart"] == "on-failure"
    assert service["ExecStart"].split()[0].endswith(f"/motiondlo-{row.name}")
    assert int(service["WatchdogSec"]) == row.watchdog_s
    assert service["LimitMEMLOCK"] == "infinity"
    if row.scheduling == Scheduling.FIFO:
        assert service["CPUSchedulingPolicy"] == "fifo"
        assert int(service["CPUSchedulingPriority"]) == row.priority
    else:
        assert int(service["Nice"]) == row.nice


def test_target_wants_every_daemon() -> None:
    lines = (UNITS / "motiondlo.target").read_text(encoding="utf-8").splitlines()
    wants = [name for line in lines if line.startswith("Wants=") for name in line.removeprefix("Wants=").split()]
    assert sorted(wants) == sorted(unit_names())


@pytest.mark.skipif(shutil.which("systemd-analyze") is None, reason="systemd-analyze is not installed")
def test_systemd_accepts_the_units(tmp_path: Path) -> None:
    for path in UNITS.iterdir():
        if path.suffix in (".service", ".target"):
            # The daemons are not installed under /opt here; everything else is as shipped.
            text = path.read_text(encoding="utf-8").replace(
                "/opt/motiondlo/venv/bin/motiondlo-", "/bin/true motiondlo-"
            )
            (tmp_path / path.name).write_text(text, encoding="utf-8")
    result = subprocess.run(
        ["systemd-analyze", "verify", *sorted(str(p) for p in tmp_path.iterdir())],
        capture_output=True,
        text=True,
        check=False,
        timeout=60,
    )
    own = [line for line in result.stderr.splitlines() if "motiondlo" in line]
    assert own == []
    assert result.returncode == 0
