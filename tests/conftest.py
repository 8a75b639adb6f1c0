"""Shared fixtures: where the simulated recordings are, if they are there."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

_BESIDE_CHECKOUT = Path(__file__).resolve().parents[2] / "shared" / "data"


def pytest_addoption(parser: pytest.Parser) -> None:
    """How hard the fuzzing and the fault-injection tests try; the defaults are short."""
    parser.addoption(
        "--fuzz-cases", type=int, default=10_000, help="damaged inputs over all decoders (nightly: 1000000)"
    )
    parser.addoption("--fuzz-seed", type=int, default=1, help="another seed tries other inputs")
    parser.addoption("--fault-rounds", type=int, default=1, help="how often every daemon is killed (thorough: 20)")
    parser.addoption("--stop-s", type=float, default=2.5, help="how long a process is stopped (thorough: 10)")
    parser.addoption("--burst-s", type=float, default=0.8, help="length of the burst of events (thorough: 1)")
    parser.addoption("--soak-s", type=float, default=20.0, help="length of the soak test (thorough: 600)")


@pytest.fixture(scope="session")
def shared_data() -> Path:
    """Folder of the simulated recordings with ground truth; skips where it is absent.

    The environment variable MOTIONDLO_TEST_DATA overrides the folder beside the checkout.
    """
    folder = Path(os.environ.get("MOTIONDLO_TEST_DATA", _BESIDE_CHECKOUT))
    if not (folder / "single_dlo1_speed5" / "events.raw").is_file():
        pytest.skip(f"simulated recordings are not at {folder}")
    return folder
