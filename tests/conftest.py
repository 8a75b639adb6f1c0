"""Shared fixtures: where the simulated recordings are, if they are there."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

_BESIDE_CHECKOUT = Path(__file__).resolve().parents[2] / "shared" / "data"


def pytest_addoption(parser: pytest.Parser) -> None:
    """How many damaged inputs the fuzzing tests try, over all decoders together."""
    parser.addoption(
        "--fuzz-cases", type=int, default=10_000, help="damaged inputs over all decoders (nightly: 1000000)"
    )
    parser.addoption("--fuzz-seed", type=int, default=1, help="another seed tries other inputs")


@pytest.fixture(scope="session")
def shared_data() -> Path:
    """Folder of the simulated recordings with ground truth; skips where it is absent.

    The environment variable MOTIONDLO_TEST_DATA overrides the folder beside the checkout.
    """
    folder = Path(os.environ.get("MOTIONDLO_TEST_DATA", _BESIDE_CHECKOUT))
    if not (folder / "single_dlo1_speed5" / "events.raw").is_file():
        pytest.skip(f"simulated recordings are not at {folder}")
    return folder
