"""Where shared memory starts to pay, measured through two sessions of this process."""

from __future__ import annotations

import queue
import statistics
import tempfile
import time
from typing import Any, Final

import zenoh

from motiondlo.bus.settings import private_config

KIB: Final = 1 << 10
SIZES: Final = (32 * KIB, 64 * KIB, 128 * KIB, 256 * KIB)
POOL_BYTES: Final = 8 * SIZES[-1]
USUAL_THRESHOLD: Final = 64 * KIB
ROUNDS: Final = 15
_PATIENCE_S: Final = 1.0
_KEY: Final = "measure"


class SharedMemoryUnusable(Exception):
    """A shared buffer arrives as a copy."""


class _TooBusy(Exception):
    """The machine is so loaded that nothing can be measured now."""


def _connected(publisher: Any) -> bool:
    return bool(publisher.matching_status.matching)


def measure_threshold() -> int:
    """The smallest of SIZES from which on a message through shared memory arrives sooner; takes about 0.1 s.

    On a machine too busy to measure it is USUAL_THRESHOLD. The pool is a small one of its own: this process maps what
    it receives, and a pool that is mapped by its own process is not removed from /dev/shm when it is given back.

    Raises SharedMemoryUnusable, zenoh.ZError.
    """
    try:
        return _measure()
    except _TooBusy:
        return USUAL_THRESHOLD


def _measure() -> int:
    provider = zenoh.shm.ShmProvider.default_backend(POOL_BYTES)
    with tempfile.TemporaryDirectory(prefix="motiondlo-") as folder:
        endpoint = f"unixsock-stream/{folder}/measure"
        with zenoh.open(private_config(endpoint, True)) as near, zenoh.open(private_config(endpoint, False)) as far:
            arrived: queue.SimpleQueue[Any] = queue.SimpleQueue()
            far.declare_subscriber(_KEY, zenoh.handlers.Callback(arrived.put, indirect=False))
            publisher = near.declare_publisher(_KEY, express=True)
            deadline = time.monotonic() + _PATIENCE_S
            while not _connected(publisher):
                if time.monotonic() > deadline:
                    raise _TooBusy
                time.sleep(0.002)
            return _first_that_pays(provider, publisher, arrived)


def _first_that_pays(provider: Any, publisher: Any, arrived: queue.SimpleQueue[Any]) -> int:
    threshold = SIZES[-1]
    for n_bytes in reversed(SIZES):
        data = bytes(n_bytes)
        plain_s = statistics.median(_plain_s(publisher, arrived, data) for _ in range(ROUNDS))
        shared_s = statistics.median(_shared_s(provider, publisher, arrived, data) for _ in range(ROUNDS))
        if shared_s > plain_s:
            break
        threshold = n_bytes
    return threshold


def _plain_s(publisher: Any, arrived: queue.SimpleQueue[Any], data: bytes) -> float:
    start = time.perf_counter()
    publisher.put(data)
    _take(arrived).to_bytes()
    return time.perf_counter() - start


def _shared_s(provider: Any, publisher: Any, arrived: queue.SimpleQueue[Any], data: bytes) -> float:
    start = time.perf_counter()
    buffer = provider.alloc(len(data), zenoh.shm.GarbageCollect())
    buffer[0 : len(data)] = data
    publisher.put(buffer)
    payload = _take(arrived)
    if payload.as_shm() is None:
        raise SharedMemoryUnusable("buffers arrive as copies")
    payload.to_bytes()
    return time.perf_counter() - start


def _take(arrived: queue.SimpleQueue[Any]) -> Any:
    try:
        return arrived.get(timeout=_PATIENCE_S).payload
    except queue.Empty:
        raise _TooBusy from None
