"""The C library's stock of memory, for processes whose loops must not wait for pages."""

from __future__ import annotations

import ctypes

_M_TRIM_THRESHOLD, _M_MMAP_THRESHOLD = -1, -3
_NEVER_BYTES = 1 << 30
EVENTS_STOCK_BYTES = 16 << 20
"""A few batches of the densest data, decoded and as messages."""


def keep_memory(stock_bytes: int) -> bool:
    """Have the C library keep what is freed, and take a stock of it now; False where it is another than glibc.

    Arrays then lie in pages that are mapped already: to map one takes 0.3 to 2 us, more than most of what is done with
    the events in it.
    """
    try:
        mallopt = ctypes.CDLL(None).mallopt
    except AttributeError:
        return False
    kept = all([mallopt(option, _NEVER_BYTES) == 1 for option in (_M_MMAP_THRESHOLD, _M_TRIM_THRESHOLD)])
    stock = bytearray(stock_bytes)
    del stock
    return kept
