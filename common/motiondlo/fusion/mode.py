"""BOOT / STATIC / MOTION / DEGRADED, with hysteresis (paper, "Hibernation and Re-initialization")."""

from __future__ import annotations

from motiondlo.fusion.params import FusionParams
from motiondlo.fusion.state import Mode


class ModeMachine:
    """Decides the scene's mode from what the tracker says of motion; motion begins at once, rest after a while."""

    def __init__(self, params: FusionParams) -> None:
        self._static_after_us = int(params.static_after_ms * 1000)
        self._moved_us: int | None = None
        self._scene = Mode.BOOT

    @property
    def scene(self) -> Mode:
        """BOOT, STATIC or MOTION, whatever the health of the cell."""
        return self._scene

    def advance(self, t_us: int, any_track: bool, any_moving: bool) -> bool:
        """Take one track update; True when the scene has just come to rest (or has its first track, at rest)."""
        before = self._scene
        if any_moving:
            self._moved_us = t_us
        if not any_track:
            self._scene = Mode.BOOT
        elif self._moved_us is not None and t_us - self._moved_us < self._static_after_us:
            self._scene = Mode.MOTION
        else:
            self._scene = Mode.STATIC
        return before == Mode.MOTION and self._scene == Mode.STATIC
