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


def test_there_is_one_unit_per_process_and_no_other() -> None:
    assert {p.name for p in UNITS.glob("*.service")} == {f"motiondlo-{row.name}.service" for row in PROCESSES}


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
    wants = read_unit(UNITS / "motiondlo.target")["Unit"]["Wants"].split()
    assert sorted(wants) == sorted(f"motiondlo-{row.name}.service" for row in PROCESSES)


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
