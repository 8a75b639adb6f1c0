"""Whose turn it is to work: one process at a time, and the next one as soon as it has ended."""

from __future__ import annotations

import subprocess
import sys
import uuid
from contextlib import closing

import pytest

from motiondlo_services.runtime.standby import ALIVE_S, LOOK_S, Turn

HOLDER = """
import sys, time
from motiondlo_services.runtime.standby import Turn
turn = Turn(sys.argv[1])
print(turn.take(), flush=True)
time.sleep(60)
"""


@pytest.fixture
def endpoint() -> str:
    """No other test's."""
    return f"tcp/test-{uuid.uuid4()}"


def never(_: float) -> None:
    raise AssertionError("there is nothing to wait for")


def test_the_first_one_has_the_turn_at_once(endpoint: str) -> None:
    with closing(Turn(endpoint)) as second, closing(Turn(endpoint + "0")) as of_another_cell:
        with closing(Turn(endpoint)) as first:
            assert first.wait(lambda: True, lambda: None, sleep=never)
            assert not second.take()
            assert of_another_cell.take()
        assert second.take()


def test_KILLED_process_loses_its_turn_to_the_one_that_stands_by(endpoint: str) -> None:
    holder = subprocess.Popen([sys.executable, "-c", HOLDER, endpoint], stdout=subprocess.PIPE, text=True)
    assert holder.stdout is not None
    try:
        assert holder.stdout.readline() == "True\n"
        waited = 0

        def kill_then_wait(_: float) -> None:
            nonlocal waited
            waited += 1
            if waited == 3:
                holder.kill()
                holder.wait()

        with closing(Turn(endpoint)) as turn:
            assert not turn.take()
            assert turn.wait(lambda: True, lambda: None, sleep=kill_then_wait)
        assert waited == 3
    finally:
        holder.kill()
        holder.wait()
        holder.stdout.close()


def test_who_stands_by_is_heard_of_and_can_be_stopped(endpoint: str) -> None:
    now_s, said = 0.0, []

    def sleep(seconds: float) -> None:
        nonlocal now_s
        assert seconds == LOOK_S
        now_s += seconds

    with closing(Turn(endpoint)) as first, closing(Turn(endpoint)) as second:
        assert first.take()
        assert not second.wait(lambda: now_s < 3.0, lambda: said.append(now_s), sleep, lambda: now_s)
    assert len(said) == pytest.approx(3.0 / ALIVE_S, abs=1)
