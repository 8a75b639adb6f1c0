"""Shared memory is used where it works, and its absence is explained."""

from __future__ import annotations

import resource

import pytest

from motiondlo.bus import shm
from motiondlo.bus.shm import FAMILIAR_EVERY, KIB, MIB, NEVER, SharedMemory, memlock_problem

HEAD = b"h" * 100


def test_switched_off_everything_goes_the_plain_way() -> None:
    memory = SharedMemory(MIB, allowed=False, why_not="LOCKED_OUT")
    assert memory.payload(HEAD, memoryview(b"t" * MIB)) == HEAD + b"t" * MIB
    report = memory.report()
    assert (report.used, report.why, report.threshold_bytes) == (False, "LOCKED_OUT", NEVER)
    assert (report.shared_messages, report.plain_messages) == (0, 0)


def test_a_small_limit_on_locked_memory_is_a_problem_with_its_remedy(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(resource, "getrlimit", lambda _: (8 * MIB, 8 * MIB))
    monkeypatch.setattr(shm, "_may_lock_anyway", lambda: False)
    assert "LimitMEMLOCK=infinity" in memlock_problem(512 * MIB)
    assert memlock_problem(4 * MIB) == ""


def test_without_a_limit_there_is_no_problem(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(resource, "getrlimit", lambda _: (resource.RLIM_INFINITY, resource.RLIM_INFINITY))
    monkeypatch.setattr(shm, "_may_lock_anyway", lambda: False)
    assert memlock_problem(1 << 40) == ""


@pytest.mark.live
def test_large_messages_take_buffers_until_the_readers_hold_them_all() -> None:
    memory = SharedMemory(4 * MIB, allowed=True)
    report = memory.report()
    if not report.used:
        pytest.skip(f"no shared memory here: {report.why}")
    assert 32 * KIB <= report.threshold_bytes <= 256 * KIB
    tail = memoryview(bytes(range(256)) * (5 * KIB))
    held = [memory.payload(HEAD, tail) for _ in range(5)]
    report = memory.report()
    assert report.shared_messages >= 1
    assert report.exhausted == report.plain_messages == 5 - report.shared_messages
    assert all(bytes(payload) == HEAD + bytes(tail) for payload in held)
    held.clear()
    memory.payload(HEAD, tail)
    assert memory.report().shared_messages == report.shared_messages + 1
    assert memory.payload(b"small", None) == b"small"


@pytest.mark.live
def test_readers_come_to_know_the_pool_before_the_first_large_message() -> None:
    memory = SharedMemory(4 * MIB, allowed=True)
    if not memory.report().used:
        pytest.skip(f"no shared memory here: {memory.report().why}")
    payloads = [memory.payload(b"small", None) for _ in range(FAMILIAR_EVERY + 1)]
    assert [k for k, payload in enumerate(payloads) if not isinstance(payload, bytes)] == [0, FAMILIAR_EVERY]
    assert memory.report().plain_messages == 0, "only large ones that went as copies count as such"
