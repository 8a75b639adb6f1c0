"""A subscriber in a process of its own, as a robot's gateway is one: it receives every state and notes when.

Whatever else a live run does (starting processes, reading processor times) stops a Python process for up to tens of
milliseconds, which would be taken for the cell's latency.
"""

from __future__ import annotations

import os
import select
import socket
import struct
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from motiondlo.bus.session import open_bus
from motiondlo.errors import MotionDLOError
from motiondlo.heap import keep_memory
from motiondlo.messages.header import Stamp
from motiondlo.messages.reject import Expectation
from motiondlo.messages.state import StateMessage
from motiondlo.topics import STATE
from motiondlo_services.cell_config import bus_section, check_configuration
from motiondlo_services.runtime.realtime import (
    ONE_THREAD,
    settle_garbage_collector,
    use_shared_processors,
    use_subscriber_scheduling,
)
from motiondlo_services.runtime.shutdown import StopFlag, die_with_parent

_HEAD = struct.Struct("<QQI")
"""Arrival (host monotonic ns; 0: ready to receive), states lost so far, bytes that follow."""
_QUEUE = 100_000
_STOCK_BYTES = 4 << 20
_WAIT_S = 0.05
_START_S = 60.0


@dataclass(frozen=True)
class Seen:
    """A state and when the subscriber had it."""

    state: StateMessage
    arrived_ns: int
    """Host monotonic time."""
    lost: int
    """States lost so far, by the gaps in their sequence."""


class StateWatch:
    """The process, from the side of whoever wants to know; use as a context."""

    def __init__(self, config: Path) -> None:
        """Start it, and wait until it receives. Raises MotionDLOError when it does not come up."""
        mine, theirs = socket.socketpair()
        with theirs:
            self._process = subprocess.Popen(
                [sys.executable, "-m", __name__, str(config), str(theirs.fileno())],
                pass_fds=(theirs.fileno(),),
                env={**os.environ, **ONE_THREAD},
                stdin=subprocess.DEVNULL,
            )
        mine.setblocking(False)
        self._socket = mine
        self._buffer = bytearray()
        self._expect = Expectation(check_configuration(config).cell.name)
        self._ready = False
        deadline_s = time.monotonic() + _START_S
        while not self._ready:
            list(self.take(_WAIT_S))
            if not self._ready and (self._process.poll() is not None or time.monotonic() > deadline_s):
                self.close()
                raise MotionDLOError("The subscriber of the live run did not start.", "See its message above.")

    def __enter__(self) -> StateWatch:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def take(self, timeout_s: float) -> Iterator[Seen]:
        """What it has seen since the last call, waiting up to ``timeout_s`` for the first."""
        if select.select([self._socket], [], [], timeout_s)[0]:
            with suppress(BlockingIOError):
                while part := self._socket.recv(1 << 20):
                    self._buffer += part
        at = 0
        while len(self._buffer) - at >= _HEAD.size:
            arrived_ns, lost, size = _HEAD.unpack_from(self._buffer, at)
            if len(self._buffer) - at < _HEAD.size + size:
                break
            payload = bytes(self._buffer[at + _HEAD.size : at + _HEAD.size + size])
            at += _HEAD.size + size
            if arrived_ns:
                yield Seen(StateMessage.from_bytes(payload, self._expect), arrived_ns, lost)
            else:
                self._ready = True
        del self._buffer[:at]

    def close(self) -> None:
        """End the process."""
        self._process.terminate()
        try:
            self._process.wait(5.0)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
        self._socket.close()


def main(argv: list[str]) -> int:
    """``argv``: the cell's configuration and the number of a socket. Returns the exit code."""
    stop = StopFlag().install()
    die_with_parent()
    config = Path(argv[0])
    with (
        socket.socket(fileno=int(argv[1])) as out,
        open_bus(bus_section(config).of_client(check_configuration(config).cell.name), "live-run") as bus,
    ):
        out.setblocking(False)
        states = bus.subscriber(STATE, queue=_QUEUE)
        settle_garbage_collector()
        keep_memory(_STOCK_BYTES)
        use_shared_processors()
        # What the reader has not taken yet waits here: receiving never waits for it.
        waiting = bytearray(_HEAD.pack(0, 0, 0))
        with use_subscriber_scheduling(starts_processes=False):
            while not stop:
                bus.wait(0.001 if waiting else _WAIT_S, states)
                for state in states.drain():
                    now_ns = time.monotonic_ns()
                    payload = state.to_bytes(Stamp(state.seq, state.cell, state.source, state.t_sent_ns))
                    waiting += _HEAD.pack(now_ns, states.ledger.lost, len(payload)) + payload
                with suppress(BlockingIOError):
                    while waiting:
                        del waiting[: out.send(waiting)]
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
