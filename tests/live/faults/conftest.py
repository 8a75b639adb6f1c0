"""Cells with real processes that things happen to. They end with the test, and nothing of theirs stays behind.

Played far slower than real time: a shared machine must not decide what is tested, and a restart that takes as long as
elsewhere then spans less of the motion.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import suppress
from pathlib import Path

import psutil
import pytest

from motiondlo.bundled import bundled_recording
from motiondlo_services.replay_cell import Scalar, write_replay_cell
from motiondlo_services.supervisor import Supervisor

MakeCell = Callable[..., Path]
MIB = 1 << 20
POOL_MIB = 43
"""Shared memory of a process of these cells: a size that nobody else's segments have."""


@pytest.fixture
def make_cell(tmp_path: Path) -> Iterator[MakeCell]:
    """Writes a configuration: ``make_cell(recording=..., speed=..., section={...})``; nothing may be left of it."""
    before = pools()

    def make(recording: Path | None = None, speed: float = 0.05, **sections: dict[str, Scalar]) -> Path:
        merged: dict[str, dict[str, Scalar]] = {
            "replay": {"speed": speed, "wait_for_tracker_s": 60.0},
            "bus": {"shared_memory_mib": POOL_MIB},
        }
        for name, values in sections.items():
            merged.setdefault(name, {}).update(values)
        return write_replay_cell(tmp_path / "cell.toml", recording or bundled_recording(), "test", merged)

    yield make
    assert not pools() - before, "left over in shared memory"


@pytest.fixture
def fault_rounds(request: pytest.FixtureRequest) -> int:
    """How often every daemon is killed."""
    return int(request.config.getoption("--fault-rounds"))


@pytest.fixture
def stop_s(request: pytest.FixtureRequest) -> float:
    """How long a process is stopped."""
    return float(request.config.getoption("--stop-s"))


@pytest.fixture
def burst_s(request: pytest.FixtureRequest) -> float:
    """Length of a burst of events, in the recording's time."""
    return float(request.config.getoption("--burst-s"))


@pytest.fixture
def soak_s(request: pytest.FixtureRequest) -> float:
    """Length of the soak."""
    return float(request.config.getoption("--soak-s"))


def pools() -> set[Path]:
    """Shared-memory segments of these cells that exist now."""
    found = set()
    for path in Path("/dev/shm").glob("*.zenoh"):
        with suppress(FileNotFoundError):  # someone else's, gone meanwhile
            if path.stat().st_size == POOL_MIB * MIB:
                found.add(path)
    return found


def memory_mib(supervisor: Supervisor) -> dict[str, float]:
    """Memory of each daemon that is its own alone."""
    used = {}
    for name, child in supervisor.children.items():
        if child.pid is not None:
            with suppress(psutil.Error):
                info = psutil.Process(child.pid).memory_full_info()
                used[name] = info.uss / MIB
    return used
