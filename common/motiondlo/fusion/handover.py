"""DLOs that a restarted tracker has yet to take over: carried on from its predecessor's last word, for a moment."""

from __future__ import annotations

from collections.abc import Iterable

from motiondlo.tracking.carrying import carried_state
from motiondlo.tracking.types import TrackState

CARRIED_US = 1_000_000
"""A DLO that the new tracker still lacks after this long is gone."""


class Handover:
    """The missing DLOs, by id."""

    def __init__(self) -> None:
        self._missing: dict[int, tuple[TrackState, int]] = {}

    def add(self, state: TrackState, t_us: int) -> None:
        """The new tracker lacks this one, whose last state was for ``t_us``."""
        self._missing[state.id] = (state, t_us)

    def complete(self, tracks: Iterable[TrackState], t_us: int) -> tuple[TrackState, ...]:
        """The tracker's DLOs, and those that it still lacks, at ``t_us``."""
        own = tuple(tracks)
        for track in own:
            self._missing.pop(track.id, None)
        for dlo_id, (_, since_us) in list(self._missing.items()):
            if t_us - since_us > CARRIED_US:
                del self._missing[dlo_id]
        return own + tuple(carried_state(state, t_us - since_us) for state, since_us in self._missing.values())
