"""SIGTERM and SIGINT as a flag that the loop looks at."""

from __future__ import annotations

import signal
from types import FrameType


class StopFlag:
    """True once the process was asked to stop."""

    def __init__(self) -> None:
        self._set = False

    def __bool__(self) -> bool:
        return self._set

    def install(self) -> StopFlag:
        """Handle SIGTERM and SIGINT (main thread only)."""
        signal.signal(signal.SIGTERM, self._handle)
        signal.signal(signal.SIGINT, self._handle)
        return self

    def _handle(self, signum: int, frame: FrameType | None) -> None:
        self._set = True
