"""For other people's programs: where the cables are, in a few lines.

from motiondlo.client import StateSubscriber

with StateSubscriber("tcp/127.0.0.1:7453", "cell1") as cell:
    for state in cell:
        for dlo in state.now():
            print(dlo.id, dlo.nodes, dlo.sigma_px)
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
"""How hard a slow DLO may be accelerated without our knowing: what makes extrapolations uncertain."""
ACCELERATION_SHARE_PER_S = 25.0
"""And a fast one, px/s^2 per px/s: strokes of a robot begin and end within some 50 ms, whatever their speed."""


class StateStale(MotionDLOError):
    """No state within the time asked for, or only one that is too old to act upon."""


@dataclass(frozen=True)
class Extrapolation:
    """One DLO, carried on from a state to another time."""

    id: int
    nodes: FloatArray
    """(M, 2) event px."""
    sigma_px: FloatArray
    """(M,) standard deviation, grown by what may have happened since."""
    ahead_us: int = 0
    """How far beyond the state's own time."""


def extrapolate(state: StateMessage, t_us: int) -> tuple[Extrapolation, ...]:
    """All DLOs at the event time ``t_us``, at constant velocity; the uncertainty grows with the time squared.

    Meant for the few milliseconds from a state to "now"; a time before the state is answered with the state itself.
    """
    ahead_us = max(0, t_us - state.t_us)
    return tuple(_ahead(dlo, ahead_us) for dlo in state.dlos)


def _ahead(dlo: StateDlo, ahead_us: int) -> Extrapolation:
    ahead_s = ahead_us * 1e-6
    velocity = dlo.velocity_px_s.astype(np.float64)
    nodes = dlo.nodes.astype(np.float64) + ahead_s * velocity
    fastest = float(np.hypot(*velocity.T).max(initial=0.0))
    acceleration = ACCELERATION_SIGMA_PX_S2 + ACCELERATION_SHARE_PER_S * fastest
    grown = 0.5 * acceleration * ahead_s**2
    return Extrapolation(dlo.id, nodes, np.hypot(dlo.sigma_px.astype(np.float64), grown), ahead_us)


@dataclass(frozen=True)
class CellState:
    """One state as it was received, with its freshness and its future.

    Freshness is told by this host's monotonic clock, at the time of asking.
    """

    message: StateMessage
    """The state itself: every field of the contract."""
    received_ns: int
    """Host monotonic time of arrival."""
    entered_ns: int
    """Host monotonic time at which the newest event used entered the system; of arrival, where the cell's clock is
    another host's."""
    stale_ms: float
    """Age from which it is stale."""
    clock: ClockMessage | None = None
    """How event time maps to the host's clock, where ingest has said so."""

    @property
    def t_us(self) -> int:
        """Event time that the estimate is for."""
        return self.message.t_us

    @property
    def mode(self) -> str:
        """BOOT, STATIC, MOTION or DEGRADED."""
        return self.message.mode

    @property
    def dlos(self) -> tuple[StateDlo, ...]:
        """Every DLO at :attr:`t_us`."""
        return self.message.dlos

    @property
    def degraded(self) -> bool:
        """Whether the cell says that something this state rests on is missing or failing, or knows no DLO yet."""
        return self.message.mode in ("DEGRADED", "BOOT")

    def age_ms_at(self, host_ns: int) -> float:
        """Age at a host monotonic time, ms."""
        return (host_ns - self.entered_ns) / 1e6

    @property
    def age_ms(self) -> float:
        """Milliseconds since the newest event used entered the system (same host), else since the state arrived."""
        return self.age_ms_at(time.monotonic_ns())

    @property
    def stale(self) -> bool:
        """Whether it is too old to act upon."""
        return self.age_ms > self.stale_ms

    def event_us(self, host_ns: int) -> int:
        """Event time at a host monotonic time, by the cell's clock.

        Where the clock is not known, by this state's own newest event: late by what that event took to come in.
        """
        if self.clock is not None:
            return self.clock.event_us(host_ns)
        return self.message.t_us + (host_ns - self.entered_ns) // 1000

    def at(self, t_us: int, allow_stale: bool = False) -> tuple[Extrapolation, ...]:
        """All DLOs at the event time ``t_us``: :func:`extrapolate`.

        Raises StateStale for a time farther ahead of the state than a state may be old, unless ``allow_stale``.
        """
        ahead_ms = (t_us - self.message.t_us) / 1e3
        if ahead_ms > self.stale_ms and not allow_stale:
            raise StateStale(
                f"The newest state is for {ahead_ms:.0f} ms before the time asked for, {self.stale_ms:g} ms at most.",
                "Wait for the next state, or pass allow_stale=True.",
            )
        return extrapolate(self.message, t_us)

    def at_host(self, host_ns: int, allow_stale: bool = False) -> tuple[Extrapolation, ...]:
        """All DLOs at a time of this host's monotonic clock. Raises as :meth:`at`."""
        return self.at(self.event_us(host_ns), allow_stale)

    def now(self, allow_stale: bool = False) -> tuple[Extrapolation, ...]:
        """All DLOs now. Raises as :meth:`at`."""
        return self.at_host(time.monotonic_ns(), allow_stale)


def entered_at(message: StateMessage, received_ns: int, same_host: bool, before: CellState | None) -> int:
    """When the newest event used entered the system, by this host's clock; of arrival, if the cell's is another one.

    A state that is sent again, because nothing comes from the event camera, is as old as it was.
    """
    if before is not None and before.message.t_ingest_ns == message.t_ingest_ns:
        return before.entered_ns
    return message.t_ingest_ns if same_host else received_ns


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
        self._newest: CellState | None = None
        self._clock: ClockMessage | None = None

    def __enter__(self) -> Self:
        self._bus = self._stack.enter_context(open_bus(self._config, self._name))
        self._subscriber = self._bus.subscriber(STATE)
        self._clocks = self._bus.subscriber(EVENTS_CLOCK) if self._config.same_host else None
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._stack.close()

    def newest(self, allow_stale: bool = False) -> CellState:
        """The newest state, without waiting.

        Raises StateStale if there is none yet, or if it is stale and ``allow_stale`` is not set.
        """
        message = self._subscriber.newest()
        if message is not None:
            self._remember(message)
        if self._newest is None:
            raise StateStale(f"No state of cell {self._config.cell} yet.", "Is fusion running?")
        if not allow_stale and self._newest.stale:
            raise StateStale(
                f"The newest state of cell {self._config.cell} is {self._newest.age_ms:.0f} ms old, "
                f"{self._stale_ms:g} ms at most.",
                "See what the cell's health says, or pass allow_stale=True.",
            )
        return self._newest

    def next(self, timeout_s: float = 1.0) -> CellState:
        """The next state that arrives. Raises StateStale if none comes within ``timeout_s``."""
        message = self._subscriber.recv(timeout_s)
        if message is None:
            raise StateStale(f"No state of cell {self._config.cell} within {timeout_s:g} s.", "Is fusion running?")
        return self._remember(message)

    def __iter__(self) -> Iterator[CellState]:
        """Every state, for ever; a silent cell is waited for."""
        while True:
            message = self._subscriber.recv(1.0)
            if message is not None:
                yield self._remember(message)

    def _remember(self, message: StateMessage) -> CellState:
        received_ns = time.monotonic_ns()
        if self._clocks is not None:
            self._clock = self._clocks.newest() or self._clock
        entered_ns = entered_at(message, received_ns, self._config.same_host, self._newest)
        self._newest = CellState(message, received_ns, entered_ns, self._stale_ms, self._clock)
        return self._newest

    @property
    def age_ms(self) -> float:
        """Age of the newest state received: :attr:`CellState.age_ms`; infinite before the first."""
        return float("inf") if self._newest is None else self._newest.age_ms

    @property
    def stale(self) -> bool:
        """Whether the newest state received is too old to act upon."""
        return self.age_ms > self._stale_ms

    @property
    def latency_ms(self) -> float:
        """From the entry of the newest event used to the arrival of the newest state, ms (same host); NaN before it."""
        if self._newest is None or not self._config.same_host:
            return float("nan")
        return (self._newest.received_ns - self._newest.entered_ns) / 1e6

    def last_value(self, timeout_s: float = 1.0) -> StateMessage | None:
        """The cell's newest state by query, for programs that look once; None if there is none."""
        try:
            return self._bus.last_value(STATE, timeout_s=timeout_s)
        except Rejected:
            return None

    def clock(self, timeout_s: float = 1.0) -> ClockMessage | None:
        """How event time maps to the host's clock now, for all states from now on; None if ingest does not answer."""
        answer = self._bus.last_value(EVENTS_CLOCK, timeout_s=timeout_s)
        self._clock = answer or self._clock
        return answer

    def at(self, t_us: int, allow_stale: bool = False) -> tuple[Extrapolation, ...]:
        """All DLOs at the event time ``t_us``, from the newest state. Raises as :meth:`newest` and `CellState.at`."""
        return self.newest(allow_stale).at(t_us, allow_stale)

    def status(self) -> InputStatus:
        """Rate, losses, refusals."""
        return self._subscriber.status()
