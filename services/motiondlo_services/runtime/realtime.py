"""Scheduling class, locked memory, garbage collector and library threads, as the process table wants them.

Each measure is taken where the machine permits it, and what was not permitted is reported: on a busy cell PC a wake-up
under normal scheduling comes 4 ms late (p99), under SCHED_FIFO 0.1 ms.
"""

from __future__ import annotations

import ctypes
import gc
import os
from collections.abc import Iterator
from contextlib import contextmanager, suppress

from motiondlo_services.processes import Process, Scheduling

# One computing thread a daemon: more of them wait for one another on a busy machine (15 times slower, measured).
ONE_THREAD = {
    "OPENBLAS_NUM_THREADS": "1",
    "OMP_NUM_THREADS": "1",
    "MKL_NUM_THREADS": "1",
    "NUMBA_NUM_THREADS": "1",
}

_SUBSCRIBER_PRIORITY = 30
_MCL_CURRENT = 1
_MCL_FUTURE = 2


def use_scheduling(process: Process) -> str:
    """Set the row's scheduling class; returns what is in force ("fifo 40", "other 0") for health."""
    if process.scheduling == Scheduling.FIFO:
        try:
            os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(process.priority))
        except (PermissionError, OSError):
            return f"other {os.nice(0)} (SCHED_FIFO not permitted)"
        return f"fifo {process.priority}"
    try:
        os.setpriority(os.PRIO_PROCESS, 0, process.nice)
    except PermissionError:
        return f"other {os.nice(0)} (nice {process.nice} not permitted)"
    return f"other {process.nice}"


@contextmanager
def use_subscriber_scheduling() -> Iterator[None]:
    """Receive as a robot's gateway would: under SCHED_FIFO where it is permitted, below the event path.

    Child processes do not inherit it.
    """
    with suppress(OSError):
        os.sched_setscheduler(0, os.SCHED_FIFO | os.SCHED_RESET_ON_FORK, os.sched_param(_SUBSCRIBER_PRIORITY))
    try:
        yield
    finally:
        with suppress(OSError):
            os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))


def lock_memory() -> bool:
    """Keep the process's pages in memory (mlockall); False where the limit on locked memory forbids it."""
    libc = ctypes.CDLL(None, use_errno=True)
    return bool(libc.mlockall(_MCL_CURRENT | _MCL_FUTURE) == 0)


def settle_garbage_collector() -> None:
    """Collect once, then leave what is alive alone, and collect young objects only rarely from now on."""
    gc.collect()
    gc.freeze()
    gc.set_threshold(50_000, 20, 1000)
