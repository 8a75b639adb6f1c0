"""Shared fixtures: where the simulated recordings are, if they are there."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

_BESIDE_CHECKOUT = Path(__file__).resolve().parents[2] / "shared" / "data"


@pytest.fixture(scope="session")
def shared_data() -> Path:
    """Folder of the simulated recordings with ground truth; skips where it is absent.

    The environment variable MOTIONDLO_TEST_DATA overrides the folder beside the checkout.
    """
    folder = Path(os.environ.get("MOTIONDLO_TEST_DATA", _BESIDE_CHECKOUT))
    if not (folder / "single_dlo1_speed5" / "events.raw").is_file():
        pytest.skip(f"simulated recordings are not at {folder}")
    return folder
