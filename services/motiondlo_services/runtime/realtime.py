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
_MCL_ONFAULT = 4


def use_scheduling(process: Process) -> str:
    """Set the row's scheduling class for all threads; returns what is in force ("fifo 40", "other 0") for health.

    The bus's own threads count as much as the daemon's: a message that was computed in time and is sent late is late.
    """
    if process.scheduling == Scheduling.FIFO:
        try:
            _schedule_all_threads(os.SCHED_FIFO, process.priority)
        except OSError:
            return f"other {os.nice(0)} (SCHED_FIFO not permitted)"
        return f"fifo {process.priority}"
    try:
        os.setpriority(os.PRIO_PROCESS, 0, process.nice)
    except PermissionError:
        return f"other {os.nice(0)} (nice {process.nice} not permitted)"
    return f"other {process.nice}"


def use_normal_scheduling() -> None:
    """The normal class for all threads: loading and closing take up to a second, and must not stop the others.

    A service manager starts daemons under their final class already, and one that only stands by loads beside those
    that work.
    """
    with suppress(OSError):
        _schedule_all_threads(os.SCHED_OTHER, 0)


@contextmanager
def use_subscriber_scheduling(starts_processes: bool = True) -> Iterator[None]:
    """Receive as a robot's gateway would: all threads under SCHED_FIFO, where permitted, below the event path.

    To be entered once the bus is open. starts_processes: what is started in it does not inherit it; nor then do the
    threads that the bus starts for its links.
    """
    policy = os.SCHED_FIFO | (os.SCHED_RESET_ON_FORK if starts_processes else 0)
    with suppress(OSError):
        _schedule_all_threads(policy, _SUBSCRIBER_PRIORITY)
    try:
        yield
    finally:
        with suppress(OSError):
            _schedule_all_threads(os.SCHED_OTHER, 0)


def _schedule_all_threads(policy: int, priority: int) -> None:
    """Raises OSError (PermissionError) where it is not permitted."""
    for thread_id in os.listdir("/proc/self/task"):
        with suppress(ProcessLookupError):  # it has ended meanwhile
            os.sched_setscheduler(int(thread_id), policy, os.sched_param(priority))


def use_processors(process: Process) -> str:
    """Keep the computing thread of a row with ``own_processor`` on the last processor, and all else off it.

    A loop that shares its processor finds its caches cold at every update, and takes up to twice as long. Only where
    there are two processors or more that this process may use. Returns what is in force, for health.
    """
    allowed = sorted(os.sched_getaffinity(0))
    if len(allowed) < 2:
        return "any"
    own, shared = {allowed[-1]}, set(allowed[:-1])
    try:
        for thread_id in os.listdir("/proc/self/task"):
            with suppress(ProcessLookupError):
                os.sched_setaffinity(int(thread_id), shared)
        if process.own_processor:
            os.sched_setaffinity(0, own)
    except OSError:
        return "any (affinity not permitted)"
    return ",".join(map(str, sorted(own if process.own_processor else shared)))


def use_shared_processors() -> None:
    """Stay off the processor that the row with ``own_processor`` computes on, as programs beside a cell should."""
    allowed = sorted(os.sched_getaffinity(0))
    if len(allowed) < 2:
        return
    for thread_id in os.listdir("/proc/self/task"):
        with suppress(OSError):
            os.sched_setaffinity(int(thread_id), set(allowed[:-1]))


def lock_memory() -> bool:
    """Keep the process's pages in memory (mlockall); False where the limit on locked memory forbids it.

    Pages are locked when they are first used: filling whole mappings at once stopped a loop for tens of milliseconds.
    """
    libc = ctypes.CDLL(None, use_errno=True)
    return bool(libc.mlockall(_MCL_CURRENT | _MCL_FUTURE | _MCL_ONFAULT) == 0)


def settle_garbage_collector() -> None:
    """Collect once, then leave what is alive alone, and collect young objects only rarely from now on."""
    gc.collect()
    gc.freeze()
    gc.set_threshold(50_000, 20, 1000)
