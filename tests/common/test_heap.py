"""Memory that was freed stays mapped."""

from __future__ import annotations

import subprocess
import sys

PROGRAM = """
import resource
import numpy as np
from motiondlo.heap import keep_memory

def faults_of_an_array():
    before = resource.getrusage(resource.RUSAGE_SELF).ru_minflt
    np.empty(1 << 20, np.int64).fill(1)
    return resource.getrusage(resource.RUSAGE_SELF).ru_minflt - before

assert keep_memory(16 << 20)
print(faults_of_an_array(), faults_of_an_array())
"""


def test_arrays_lie_in_memory_that_is_mapped_already() -> None:
    """8 MiB are 2048 pages; in a process of its own, since this changes the process for good."""
    done = subprocess.run([sys.executable, "-c", PROGRAM], capture_output=True, text=True, check=True)
    assert all(int(faults) < 50 for faults in done.stdout.split())
