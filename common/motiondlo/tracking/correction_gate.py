"""The late-correction rule: which corrections a tracker takes, when, and against which of its own past states.

A frame's shape belongs to the frame's trigger time and arrives about a second later. A tracker therefore keeps its own
states of the last seconds, and every tracker refuses the same corrections for the same counted reasons.
"""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from typing import Generic, TypeVar

import numpy as np

from motiondlo.rejects import RejectCounter, RejectReason
from motiondlo.tracking.types import Correction, CorrectionKind

State = TypeVar("State")

DEFAULT_HISTORY_US = 3_000_000
# The first frame's shape starts a track before the first events are in, and clocks of two processes never agree to the
# microsecond: two frame periods ahead is still "now".
DEFAULT_FUTURE_SLACK_US = 100_000


class StateHistory(Generic[State]):
    """States of one DLO by time, oldest first; a state holds until the next one, so rest needs no entries.

    The entry that holds at the start of the kept span is kept as well, however old it is.
    """

    def __init__(self, span_us: int = DEFAULT_HISTORY_US) -> None:
        self._span_us = span_us
        self._times_us: list[int] = []
        self._states: list[State] = []
        self._first = 0  # entries before it are forgotten; the lists are cut when that pays

    def record(self, t_us: int, state: State) -> None:
        """Add the state that holds from ``t_us`` on; a state at the newest time replaces it.

        Entries that lie after ``t_us`` are forgotten: they are a first frame's, whose shape started the track before
        the first events were in, or of a time line that has ended (the camera's clock was set back).
        """
        while self._times_us and t_us < self._times_us[-1]:
            self._times_us.pop()
            self._states.pop()
            self._first = min(self._first, len(self._times_us))
        if self._times_us and t_us == self._times_us[-1]:
            self._states[-1] = state
            return
        self._times_us.append(t_us)
        self._states.append(state)
        while self._first + 1 < len(self._times_us) and self._times_us[self._first + 1] <= t_us - self._span_us:
            self._first += 1
        if self._first > 1024:
            del self._times_us[: self._first]
            del self._states[: self._first]
            self._first = 0

    def at(self, t_us: int) -> State | None:
        """The state that held at ``t_us``: the newest at or before it; None before the first kept entry."""
        k = bisect_right(self._times_us, t_us) - 1
        return self._states[k] if k >= self._first else None

    def revise(self, since_us: int, change: Callable[[State], State]) -> None:
        """Replace every state that held at or after ``since_us`` by ``change(state)``.

        A correction absorbed for t0 changes what later corrections must be compared with: without this, the same error
        would be corrected once per segmentation in flight.
        """
        start = max(bisect_right(self._times_us, since_us) - 1, self._first)
        for k in range(start, len(self._states)):
            self._states[k] = change(self._states[k])

    def __len__(self) -> int:
        return len(self._times_us) - self._first

    def __iter__(self) -> Iterator[tuple[int, State]]:
        return iter(zip(self._times_us[self._first :], self._states[self._first :], strict=True))

    @property
    def oldest_us(self) -> int | None:
        """Time of the oldest kept entry, None while empty."""
        return self._times_us[self._first] if self._times_us else None


@dataclass
class _Life(Generic[State]):
    """What the gate remembers of one living DLO."""

    started_us: int
    """Event time at which it was last started or re-initialised."""
    newest_correction_us: int
    """Time of the newest correction absorbed, -1 for none."""
    history: StateHistory[State]


@dataclass
class _Sequence:
    """Sequence numbers of the fusion process, to tell repeats and reordering from a restart of that process."""

    newest_seq: int = -1
    newest_t_us: int = -1
    seen: set[int] = field(default_factory=set)

    def judge(self, correction: Correction) -> RejectReason | None:
        if correction.seq > self.newest_seq or self._restarted(correction):
            return None
        return RejectReason.REPEATED if correction.seq in self.seen else RejectReason.OUT_OF_ORDER

    def _restarted(self, correction: Correction) -> bool:
        """A lower number for a newer frame than any before: fusion was restarted and counts from its own start."""
        return correction.seq <= self.newest_seq and correction.t_us > self.newest_t_us and self.newest_t_us >= 0

    def take(self, correction: Correction) -> None:
        if self._restarted(correction):
            self.seen.clear()
            self.newest_seq = -1
        self.newest_seq = max(self.newest_seq, correction.seq)
        self.newest_t_us = max(self.newest_t_us, correction.t_us)
        self.seen.add(correction.seq)
        if len(self.seen) > 512:
            self.seen = {seq for seq in self.seen if seq > self.newest_seq - 256}


class CorrectionGate(Generic[State]):
    """Checks, queues and releases corrections; holds the history of every living DLO's states.

    Use: ``started`` / ``retired`` when tracks begin, begin anew and end; ``history(id).record`` after each update;
    ``admit`` when a correction arrives; ``due`` between two updates, and ``absorbed`` for each that was applied.
    """

    def __init__(self, history_us: int = DEFAULT_HISTORY_US, future_slack_us: int = DEFAULT_FUTURE_SLACK_US) -> None:
        self._history_us = history_us
        self._future_slack_us = future_slack_us
        self._lives: dict[int, _Life[State]] = {}
        self._sequence = _Sequence()
        self._waiting: list[Correction] = []
        self.rejects = RejectCounter()

    # lives of DLOs

    def started(self, dlo_id: int, t_us: int) -> None:
        """A track starts, or starts anew, at event time ``t_us``: what speaks of earlier times is superseded."""
        newest = self._lives[dlo_id].newest_correction_us if dlo_id in self._lives else -1
        self._lives[dlo_id] = _Life(t_us, newest, StateHistory(self._history_us))

    def retired(self, dlo_id: int) -> None:
        """The track ended; its id is unknown from now on."""
        self._lives.pop(dlo_id, None)

    def history(self, dlo_id: int) -> StateHistory[State]:
        """The states of a living DLO. Raises KeyError for an unknown id."""
        return self._lives[dlo_id].history

    # corrections

    def check(self, correction: Correction, now_us: int) -> RejectReason | None:
        """The reason to refuse ``correction`` at event time ``now_us``, or None; changes nothing."""
        return (
            _malformed(correction)
            or self._sequence.judge(correction)
            or (RejectReason.FUTURE_TIME if correction.t_us > max(now_us, 0) + self._future_slack_us else None)
            or self._out_of_time(correction, now_us)
        )

    def admit(self, correction: Correction, now_us: int) -> RejectReason | None:
        """Check a correction and queue it until its ``not_before_us``; count and return the reason if it is refused.

        A correction that is queued for later is held against the clock again when it is due: its frame may lie ahead of
        ``now_us`` as long as it does not lie after its own ``not_before_us``.
        """
        reason = self.check(correction, max(now_us, correction.not_before_us))
        if reason is RejectReason.UNKNOWN_ID and self._will_start(correction.id):
            reason = None
        if reason is not None:
            self.rejects.count(reason)
            return reason
        self._sequence.take(correction)
        self._waiting.append(correction)
        return None

    def due(self, now_us: int) -> list[Correction]:
        """Corrections whose time has come, in order of ``seq``; those that became invalid while waiting are counted.

        The caller applies each before it asks for the next batch, and reports it with :meth:`absorbed`. Two for the
        same DLO in one answer are checked again by :meth:`still_valid`.
        """
        ready = [c for c in self._waiting if c.not_before_us <= now_us]
        self._waiting = [c for c in self._waiting if c.not_before_us > now_us]
        return ready

    def still_valid(self, correction: Correction, now_us: int) -> bool:
        """Check a due correction against the DLOs as they are now; a refusal is counted."""
        reason = self._out_of_time(correction, now_us)
        if reason is None and correction.t_us > max(now_us, 0) + self._future_slack_us:
            reason = RejectReason.FUTURE_TIME
        if reason is not None:
            self.rejects.count(reason)
        return reason is None

    def absorbed(self, correction: Correction) -> None:
        """The correction was applied to a living DLO: an older one of the same DLO comes out of order from now on."""
        life = self._lives.get(correction.id)
        if life is not None:
            life.newest_correction_us = max(life.newest_correction_us, correction.t_us)

    @property
    def waiting(self) -> int:
        """How many corrections are queued."""
        return len(self._waiting)

    def _will_start(self, dlo_id: int) -> bool:
        return any(c.id == dlo_id and c.kind is CorrectionKind.REINITIALISE for c in self._waiting)

    def _out_of_time(self, correction: Correction, now_us: int) -> RejectReason | None:
        life = self._lives.get(correction.id)
        if correction.kind is CorrectionKind.REINITIALISE:
            # A shape from before the last start would undo what was learned since; the first one always starts.
            if life is not None and correction.t_us < life.newest_correction_us:
                return RejectReason.OUT_OF_ORDER
            return None
        if life is None:
            return RejectReason.UNKNOWN_ID
        if correction.kind is CorrectionKind.RETIRE:
            return None
        if correction.t_us <= life.newest_correction_us:
            return RejectReason.OUT_OF_ORDER
        if correction.t_us < life.started_us:
            return RejectReason.SUPERSEDED
        if correction.t_us < now_us - self._history_us:
            return RejectReason.TOO_OLD
        if life.history.at(correction.t_us) is None:
            return RejectReason.TOO_OLD
        return None


def _malformed(correction: Correction) -> RejectReason | None:
    if correction.kind is CorrectionKind.RETIRE:
        return None
    nodes = correction.nodes
    m = len(nodes)
    if nodes.ndim != 2 or nodes.shape[1:] != (2,) or m < 2:
        return RejectReason.WRONG_SHAPE
    if correction.sigma_normal_px.shape != (m,) or correction.sigma_tangent_px.shape != (m,):
        return RejectReason.WRONG_SHAPE
    finite = np.isfinite(nodes).all() and np.isfinite(correction.diameter_px)
    finite = finite and np.isfinite(correction.sigma_normal_px).all() and np.isfinite(correction.sigma_tangent_px).all()
    if not finite:
        return RejectReason.NOT_FINITE
    if correction.diameter_px < 0 or not np.hypot(*np.diff(nodes, axis=0).T).sum() > 0.0:
        return RejectReason.IMPLAUSIBLE
    return None
