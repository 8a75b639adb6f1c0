"""The machine: processors, scheduling, locked memory, shared memory, clock, versions, compiled kernels."""

from __future__ import annotations

import importlib.metadata
import os
import resource
import shutil
import sys
import tempfile
from pathlib import Path

from motiondlo_services.doctor.findings import Finding, failure, ok, warning

_SHM_FREE_MIB = 256
_MEMLOCK_MIB = 256
_PACKAGES = ("eclipse-zenoh", "msgpack", "numba", "numpy", "opencv-python-headless", "pydantic", "scipy")


def check_machine() -> list[Finding]:
    """Every finding about the machine; takes no more than a moment and changes nothing."""
    return [
        _python(),
        _packages(),
        _processors(),
        _scheduling(),
        _locked_memory(),
        _shared_memory(),
        _clock(),
        _kernel_cache(),
    ]


def _python() -> Finding:
    return ok("python", "version " + ".".join(map(str, sys.version_info[:3])))


def _packages() -> Finding:
    try:
        versions = [f"{name} {importlib.metadata.version(name)}" for name in _PACKAGES]
    except importlib.metadata.PackageNotFoundError as error:
        return failure(
            "packages", f"{error.name} is not installed", "Install the package again: pip install motiondlo."
        )
    return ok("packages", ", ".join(versions))


def _processors() -> Finding:
    count = len(os.sched_getaffinity(0))
    if count < 2:
        return warning(
            "processors", f"{count}", "Give the cell two processors or more: one of them for the event path."
        )
    return ok("processors", f"{count}")


def _scheduling() -> Finding:
    pid = os.fork()
    if pid == 0:  # a child, so that this process keeps its class whatever the answer is
        try:
            os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(1))
        except OSError:
            os._exit(1)
        os._exit(0)
    _, status = os.waitpid(pid, 0)
    if status == 0:
        return ok("real-time scheduling", "SCHED_FIFO is permitted")
    return warning(
        "real-time scheduling",
        "SCHED_FIFO is not permitted: wake-ups may come 4 ms late on a busy machine",
        "Use the systemd units, or raise RLIMIT_RTPRIO for this user in /etc/security/limits.d.",
    )


def _locked_memory() -> Finding:
    soft, _ = resource.getrlimit(resource.RLIMIT_MEMLOCK)
    if os.geteuid() == 0 or soft == resource.RLIM_INFINITY or soft >= _MEMLOCK_MIB << 20:
        return ok("locked memory", "enough for shared-memory messages")
    return failure(
        "locked memory",
        f"limit {soft >> 20} MiB: shared-memory messages would be lost in silence",
        "Use the systemd units (LimitMEMLOCK=infinity), or raise memlock in /etc/security/limits.d.",
    )


def _shared_memory() -> Finding:
    try:
        free_mib = shutil.disk_usage("/dev/shm").free >> 20
    except OSError:
        return failure("shared memory", "/dev/shm is not there", "Mount a tmpfs at /dev/shm.")
    if free_mib < _SHM_FREE_MIB:
        return warning("shared memory", f"{free_mib} MiB free in /dev/shm", f"Free {_SHM_FREE_MIB} MiB or more there.")
    return ok("shared memory", f"{free_mib} MiB free in /dev/shm")


def _clock() -> Finding:
    path = Path("/sys/devices/system/clocksource/clocksource0/current_clocksource")
    try:
        source = path.read_text(encoding="ascii").strip()
    except OSError:
        return ok("clock", "monotonic (source unknown)")
    if source in ("tsc", "kvm-clock", "hyperv_clocksource_tsc_page", "arch_sys_counter"):
        return ok("clock", f"source {source}")
    return warning(
        "clock", f"source {source} is slow to read", "Use the tsc clock source (kernel option tsc=reliable)."
    )


def _kernel_cache() -> Finding:
    folder = os.environ.get("NUMBA_CACHE_DIR") or str(Path(__file__).resolve().parent)
    try:
        with tempfile.NamedTemporaryFile(dir=folder):
            pass
    except OSError:
        return warning(
            "compiled kernels",
            f"{folder} is not writable: every start compiles anew",
            "Set NUMBA_CACHE_DIR to a folder that the daemons may write.",
        )
    return ok("compiled kernels", "cache is writable")
