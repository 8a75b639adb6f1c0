"""Latencies since the last health message, as quantiles; bounded memory."""

from __future__ import annotations

from collections import deque

import numpy as np

from motiondlo.messages.health import Quantiles

_KEPT = 4096


class LatencyWindow:
    """The newest latencies of one kind."""

    def __init__(self) -> None:
        self._values_ns: deque[int] = deque(maxlen=_KEPT)

    def add(self, value_ns: int) -> None:
        """One more."""
        self._values_ns.append(value_ns)

    def take(self) -> Quantiles | None:
        """The distribution since the last call, None without any; starts anew."""
        if not self._values_ns:
            return None
        values = np.maximum(np.array(self._values_ns, dtype=np.float64), 0.0) / 1e6
        self._values_ns.clear()
        p50, p99 = np.percentile(values, (50, 99))
        return Quantiles(p50=float(p50), p99=float(p99), max=float(values.max()))
