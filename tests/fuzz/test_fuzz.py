"""Damaged inputs for every decoder: no crash, no wrong time, no growth of memory.

10 000 inputs by default; a nightly run takes ``pytest tests/fuzz --fuzz-cases 1000000 --timeout 0``. A failure names
the input; the same ``--fuzz-seed`` repeats it.
"""

from __future__ import annotations

import gc
import random
from pathlib import Path

import psutil
import pytest
from tests.fuzz.mutation import damaged
from tests.fuzz.targets import TARGETS, Target

MIB = 1 << 20
GROWTH_MIB = 64
WARM_CASES = 200


@pytest.mark.parametrize("target", TARGETS, ids=lambda target: target.name)
def test_FUZZ_every_input_is_decoded_or_refused(target: Target, tmp_path: Path, request: pytest.FixtureRequest) -> None:
    cases = request.config.getoption("--fuzz-cases") // len(TARGETS)
    seeds = target.seeds(tmp_path)
    process, start_bytes = psutil.Process(), 0
    for seed in seeds:
        target.check(seed, tmp_path)
    for number in range(cases):
        rng = random.Random(f"{request.config.getoption('--fuzz-seed')} {target.name} {number}")
        data = damaged(seeds, rng)
        try:
            target.check(data, tmp_path)
        except BaseException as error:
            error.add_note(f"{target.name}, case {number}: {data.hex()}")
            raise
        if number == min(WARM_CASES, cases - 1):
            gc.collect()
            start_bytes = process.memory_info().rss
    gc.collect()
    assert process.memory_info().rss - start_bytes < GROWTH_MIB * MIB
