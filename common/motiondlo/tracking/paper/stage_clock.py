"""Host time per stage of an update."""

from __future__ import annotations

import time


class StageClock:
    """Adds the time since the last lap to a named stage; starts at its making."""

    def __init__(self) -> None:
        self.stages_ns: dict[str, int] = {}
        self._last_ns = time.perf_counter_ns()

    def lap(self, stage: str) -> None:
        """Book the time since the last lap under ``stage``."""
        now_ns = time.perf_counter_ns()
        self.stages_ns[stage] = self.stages_ns.get(stage, 0) + now_ns - self._last_ns
        self._last_ns = now_ns
