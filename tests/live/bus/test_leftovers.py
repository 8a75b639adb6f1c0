"""Nothing is left over in shared memory, however a sender ended."""

from __future__ import annotations

import signal
from collections.abc import Callable
from pathlib import Path

import pytest
from tests.live.bus.conftest import Process

pytestmark = pytest.mark.live

POOL_MIB = 37
"""A size that nobody else's segments have."""


def pools() -> set[str]:
    """Segments of this test's size."""
    found = set()
    for path in Path("/dev/shm").glob("*.zenoh"):
        try:
            size = path.stat().st_size
        except FileNotFoundError:  # someone else's, gone meanwhile
            continue
        if size == POOL_MIB << 20:
            found.add(path.name)
    return found


def start(worker: Callable[..., Process]) -> Process:
    """A sender of large batches."""
    return worker("publish", "one", name="events/batch", hz=50, bus={"shared_memory_mib": POOL_MIB})


def test_a_sender_that_ends_gives_its_pool_back(worker: Callable[..., Process]) -> None:
    process = start(worker)
    if not pools():
        pytest.skip("no shared memory on this machine")
    process.signal(signal.SIGTERM)
    assert process.child.wait(timeout=10.0) == 0
    assert pools() == set()


def test_the_pool_of_a_killed_sender_is_gone_after_its_restart(worker: Callable[..., Process]) -> None:
    process = start(worker)
    killed = pools()
    if not killed:
        pytest.skip("no shared memory on this machine")
    process.signal(signal.SIGKILL)
    process.child.wait()
    again = start(worker)
    assert not pools() & killed
    again.signal(signal.SIGTERM)
    assert again.child.wait(timeout=10.0) == 0
    assert pools() == set()
