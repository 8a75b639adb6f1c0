"""BOOT / STATIC / MOTION / DEGRADED, and which DLO rests (paper, "Hibernation and Re-initialization", per DLO)."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

from motiondlo.fusion.params import FusionParams
from motiondlo.fusion.state import Mode
from motiondlo.tracking.types import TrackState


@dataclass(frozen=True)
class RestChange:
    """What one track update changed: ids of the DLOs that came to rest, and of those that began to move."""

    rested: frozenset[int] = frozenset()
    stirred: frozenset[int] = frozenset()


class ModeMachine:
    """Follows which DLO moves and which rests; motion begins at once, rest after a while."""

    def __init__(self, params: FusionParams) -> None:
        self._static_after_us = int(params.static_after_ms * 1000)
        self._moved_us: dict[int, int] = {}
        """By id: when a DLO that is not at rest was last seen to move."""
        self._scene = Mode.BOOT

    @property
    def scene(self) -> Mode:
        """BOOT, STATIC (all rest) or MOTION, whatever the health of the cell."""
        return self._scene

    def resting(self, dlo_id: int) -> bool:
        """Whether this DLO rests."""
        return dlo_id not in self._moved_us

    def advance(self, t_us: int, tracks: Iterable[TrackState]) -> RestChange:
        """Take one track update."""
        tracks = tuple(tracks)
        alive = {track.id for track in tracks}
        self._moved_us = {dlo_id: at for dlo_id, at in self._moved_us.items() if dlo_id in alive}
        stirred = set()
        for track in tracks:
            if track.moving:
                if track.id not in self._moved_us:
                    stirred.add(track.id)
                self._moved_us[track.id] = t_us
        rested = {dlo_id for dlo_id, at in self._moved_us.items() if t_us - at >= self._static_after_us}
        for dlo_id in rested:
            del self._moved_us[dlo_id]
        self._scene = Mode.BOOT if not tracks else Mode.MOTION if self._moved_us else Mode.STATIC
        return RestChange(frozenset(rested), frozenset(stirred))
