"""Regions of a running tracker: set by command, shown by get_config and in its health, refused with a reason."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import pytest

from motiondlo.bus.errors import CommandError
from motiondlo.bus.session import Bus, open_bus
from motiondlo.topics import HEALTH
from motiondlo_services.cell_config import bus_section

pytestmark = pytest.mark.live

BELT = (0.0, 10.0, 60.0, 20.0)


def shown(bus: Bus) -> dict[str, list[float]]:
    """The regions in force, once the tracker answers."""
    until = time.monotonic() + 60.0
    while True:
        try:
            (answer,) = bus.ask("get_config", target="event-tracker")
        except CommandError:
            if time.monotonic() > until:
                raise
        else:
            return dict(json.loads(str(answer.result["regions"])))


def start(config: Path) -> subprocess.Popen[bytes]:
    return subprocess.Popen([sys.executable, "-m", "motiondlo_services.event_tracker.daemon", "--config", str(config)])


def test_a_region_is_set_while_the_tracker_runs_and_kept(make_cell: Callable[..., Path], tmp_path: Path) -> None:
    config = make_cell()
    text = config.read_text().replace("[cell]", f'[cell]\nstate_folder = "{tmp_path / "state"}"')
    config.write_text(text + "\n[event_tracker.regions]\nrail = [0, 0, 1, 1]\n")
    daemon = start(config)
    try:
        with open_bus(bus_section(config).of_client("test", "event-tracker"), "tester") as bus:
            health = bus.subscriber(HEALTH)
            assert shown(bus) == {"rail": [0.0, 0.0, 1.0, 1.0]}
            bus.ask("set_region", {"name": "belt", "corners": BELT}, target="event-tracker")
            assert shown(bus)["belt"] == list(BELT)
            with pytest.raises(CommandError, match="four numbers"):
                bus.ask("set_region", {"name": "belt", "corners": (1.0,)}, target="event-tracker")
            until = time.monotonic() + 10.0
            counted = -1
            while counted != 2 and time.monotonic() < until:
                bus.wait(0.5, health)
                for message in health.drain():
                    counted = int(message.info.get("masked_regions", -1))
            assert counted == 2
            daemon.kill()
            daemon.wait()
            daemon = start(config)
            assert shown(bus) == {"rail": [0.0, 0.0, 1.0, 1.0], "belt": list(BELT)}
    finally:
        daemon.send_signal(signal.SIGINT)
        assert daemon.wait(20) == 0
