"""Shared memory, all of it: whether this machine can, from which size on it pays, and what was done.

zenoh's shared-memory buffers take bytes and give bytes, so a hop costs one copy in and one out and none between the
processes. Below some size the sockets' own copies are cheaper; where that size lies is measured at start.

Considered and rejected: zenoh's implicit shared memory (from 3 KiB on, where it costs more than it saves), the policy
BlockOn (a reader that holds all buffers would stop the sender for ever), views mapped by zenoh's debug text (they
save the copies of a large image, on undocumented grounds).
"""

from __future__ import annotations

import resource
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import zenoh

from motiondlo.bus.shm_measure import SharedMemoryUnusable, measure_threshold
from motiondlo.messages.wire import Tail

KIB: Final = 1 << 10
MIB: Final = 1 << 20
NEVER: Final = 1 << 62
FAMILIAR_EVERY: Final = 256
"""The first of so many messages goes through shared memory whatever its size: a reader maps and locks the sender's pool
with the first one that it gets, for up to 100 ms, which must not be when the first burst comes."""
_CAP_IPC_LOCK: Final = 14


def memlock_problem(needed_bytes: int) -> str:
    """Why this process may not lock ``needed_bytes`` in memory (shared memory is locked); empty if it may."""
    soft, _ = resource.getrlimit(resource.RLIMIT_MEMLOCK)
    if soft == resource.RLIM_INFINITY or soft >= needed_bytes or _may_lock_anyway():
        return ""
    return (
        f"RLIMIT_MEMLOCK is {soft // KIB} KiB, {needed_bytes // KIB} KiB are needed (LimitMEMLOCK=infinity in the unit)"
    )


def _may_lock_anyway() -> bool:
    try:
        status = Path("/proc/self/status").read_text(encoding="ascii", errors="replace")
    except OSError:
        return False
    for line in status.splitlines():
        if line.startswith("CapEff:"):
            return bool(int(line.split()[1], 16) >> _CAP_IPC_LOCK & 1)
    return False


@dataclass(frozen=True)
class SharedMemoryReport:
    """Which way large messages take, for health and doctor."""

    used: bool
    why: str
    """Why not, or empty."""
    threshold_bytes: int
    shared_messages: int
    plain_messages: int
    """Large messages that went the plain way all the same."""
    exhausted: int
    """Of those: because readers held all buffers."""


class SharedMemory:
    """The pool of one sending process."""

    def __init__(self, pool_bytes: int, allowed: bool, why_not: str = "") -> None:
        """``allowed``: the session has shared memory on; ``why_not`` says why it does not."""
        self._provider: Any = None
        self._why = why_not
        self._threshold_bytes = NEVER
        self._messages = self._shared = self._plain = self._exhausted = 0
        if not allowed:
            self._why = self._why or "switched off in the configuration"
            return
        try:
            self._provider = zenoh.shm.ShmProvider.default_backend(pool_bytes)
            self._threshold_bytes = measure_threshold()
        except (zenoh.ZError, SharedMemoryUnusable) as error:
            self._provider, self._why = None, f"a pool of {pool_bytes // MIB} MiB does not work: {error}"

    def payload(self, head: bytes, tail: Tail | None) -> Any:
        """What to put: a shared buffer, or the plain bytes where that is cheaper or the only way."""
        n_bytes = len(head) + (len(tail) if tail is not None else 0)
        familiar = self._threshold_bytes != NEVER and self._messages % FAMILIAR_EVERY == 0
        self._messages += 1
        if n_bytes >= self._threshold_bytes or familiar:
            buffer = self._fill(head, tail, n_bytes)
            if buffer is not None:
                self._shared += 1
                return buffer
            self._plain += 1
        return head if tail is None else b"".join((head, tail))

    def _fill(self, head: bytes, tail: Tail | None, n_bytes: int) -> Any:
        try:
            buffer = self._provider.alloc(n_bytes, zenoh.shm.GarbageCollect())
        except zenoh.ZError:
            self._exhausted += 1
            return None
        buffer[0 : len(head)] = head
        if tail is not None:
            # In pieces, so that the bytes objects that zenoh wants stay within the cache.
            for start in range(0, len(tail), MIB):
                piece = bytes(tail[start : start + MIB])
                buffer[len(head) + start : len(head) + start + len(piece)] = piece
        return buffer

    def close(self) -> None:
        """Give the pool back now: what lives until the interpreter's end stays behind in /dev/shm."""
        self._provider, self._why, self._threshold_bytes = None, "closed", NEVER

    def report(self) -> SharedMemoryReport:
        """Which way messages take, and how many took it."""
        used = self._provider is not None
        return SharedMemoryReport(used, self._why, self._threshold_bytes, self._shared, self._plain, self._exhausted)
