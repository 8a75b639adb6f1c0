"""For other people's programs: where the cables are, in a few lines.

from motiondlo.client import StateSubscriber

with StateSubscriber("tcp/127.0.0.1:7450", "cell1") as cell:
    for state in cell:
        print(state.t_us, state.mode, [dlo.nodes for dlo in state.dlos])
"""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping
from contextlib import ExitStack
from dataclasses import dataclass
from types import TracebackType
from typing import Self

import numpy as np
import numpy.typing as npt
from pydantic import JsonValue

from motiondlo.bus.config import BusConfig
from motiondlo.bus.session import open_bus
from motiondlo.bus.subscriber import InputStatus
from motiondlo.errors import MotionDLOError
from motiondlo.messages.events import ClockMessage
from motiondlo.messages.reject import Rejected
from motiondlo.messages.state import StateDlo, StateMessage
from motiondlo.topics import EVENTS_CLOCK, STATE

FloatArray = npt.NDArray[np.float64]

ACCELERATION_SIGMA_PX_S2 = 2000.0
"""How hard a cable may be accelerated without our knowing: what makes extrapolations uncertain."""


class StateStale(MotionDLOError):
    """No state within the time asked for."""


@dataclass(frozen=True)
class Extrapolation:
    """One DLO, carried on from a state to another time."""

    id: int
    nodes: FloatArray
    """(M, 2) event px."""
    sigma_px: FloatArray
    """(M,) standard deviation, grown by what may have happened since."""


def extrapolate(state: StateMessage, t_us: int) -> tuple[Extrapolation, ...]:
    """All DLOs at the event time ``t_us``, at constant velocity; the uncertainty grows with the time squared.

    Meant for the few milliseconds from a state to "now"; a time before the state is answered with the state itself.
    """
    ahead_s = max(0, t_us - state.t_us) * 1e-6
    return tuple(_ahead(dlo, ahead_s) for dlo in state.dlos)


def _ahead(dlo: StateDlo, ahead_s: float) -> Extrapolation:
    nodes = dlo.nodes.astype(np.float64) + ahead_s * dlo.velocity_px_s
    grown = 0.5 * ACCELERATION_SIGMA_PX_S2 * ahead_s**2
    return Extrapolation(dlo.id, nodes, np.hypot(dlo.sigma_px.astype(np.float64), grown))


class StateSubscriber:
    """The state of one cell. Use it in ``with``; one thread.

    Raises BusError on entering if nobody answers at ``endpoint`` within ``open_timeout_s``.
    """

    def __init__(
        self,
        endpoint: str,
        cell: str,
        name: str = "client",
        same_host: bool = True,
        stale_ms: float = 100.0,
        open_timeout_s: float = 10.0,
        tls: Mapping[str, JsonValue] | None = None,
    ) -> None:
        """``same_host`` False: the cell runs on another machine, whose clock cannot be compared with this one's.

        tls: certificates for a cell's gate, as :func:`motiondlo.security.tls.tls_settings` gives them.
        """
        self._config = BusConfig(
            cell=cell,
            mode="client",
            connect=(endpoint,),
            same_host=same_host,
            shared_memory=False,
            open_timeout_s=open_timeout_s,
            zenoh=dict(tls or {}),
        )
        self._name, self._stale_ms = name, stale_ms
        self._stack = ExitStack()
        self._newest: StateMessage | None = None
        self._received_ns = -1

    def __enter__(self) -> Self:
        self._bus = self._stack.enter_context(open_bus(self._config, self._name))
        self._subscriber = self._bus.subscriber(STATE)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._stack.close()

    def newest(self) -> StateMessage | None:
        """The newest state, without waiting; None before the first. It may be old: see :attr:`age_ms`."""
        self._remember(self._subscriber.newest())
        return self._newest

    def next(self, timeout_s: float = 1.0) -> StateMessage:
        """The next state that arrives. Raises StateStale if none comes within ``timeout_s``."""
        state = self._subscriber.recv(timeout_s)
        if state is None:
            raise StateStale(f"No state of cell {self._config.cell} within {timeout_s:g} s.", "Is fusion running?")
        self._remember(state)
        return state

    def __iter__(self) -> Iterator[StateMessage]:
        """Every state, for ever; a silent cell is waited for."""
        while True:
            state = self._subscriber.recv(1.0)
            if state is not None:
                self._remember(state)
                yield state

    def _remember(self, state: StateMessage | None) -> None:
        if state is not None:
            self._newest, self._received_ns = state, time.monotonic_ns()

    @property
    def age_ms(self) -> float:
        """Milliseconds since the newest event used entered the system (same host), else since the state arrived.

        Infinite before the first state.
        """
        if self._newest is None:
            return float("inf")
        since_ns = self._newest.t_ingest_ns if self._config.same_host else self._received_ns
        return (time.monotonic_ns() - since_ns) / 1e6

    @property
    def stale(self) -> bool:
        """Whether the newest state is too old to act upon."""
        return self.age_ms > self._stale_ms

    @property
    def latency_ms(self) -> float:
        """From the entry of the newest event used to the arrival of the newest state, ms (same host); NaN before it."""
        if self._newest is None or not self._config.same_host:
            return float("nan")
        return (self._received_ns - self._newest.t_ingest_ns) / 1e6

    def last_value(self, timeout_s: float = 1.0) -> StateMessage | None:
        """The cell's newest state by query, for programs that look once; None if there is none."""
        try:
            return self._bus.last_value(STATE, timeout_s=timeout_s)
        except Rejected:
            return None

    def clock(self, timeout_s: float = 1.0) -> ClockMessage | None:
        """How event time maps to the host's clock now; None if ingest does not answer."""
        return self._bus.last_value(EVENTS_CLOCK, timeout_s=timeout_s)

    def at(self, t_us: int) -> tuple[Extrapolation, ...]:
        """All DLOs at the event time ``t_us``, from the newest state (empty before it): :func:`extrapolate`."""
        state = self.newest()
        return () if state is None else extrapolate(state, t_us)

    def status(self) -> InputStatus:
        """Rate, losses, refusals."""
        return self._subscriber.status()
