"""Extrapolation from a state to now."""

from __future__ import annotations

import numpy as np
from tests.common.messages.examples import points, state

from motiondlo.client import ACCELERATION_SIGMA_PX_S2, extrapolate


def test_nodes_move_with_their_velocity_and_grow_uncertain() -> None:
    (dlo,) = extrapolate(state(), state().t_us + 100_000)
    np.testing.assert_allclose(dlo.nodes, points() + 2.0, atol=1e-4)
    np.testing.assert_allclose(dlo.sigma_px, np.hypot(0.5, 0.5 * ACCELERATION_SIGMA_PX_S2 * 0.01), rtol=1e-6)


def test_a_time_before_the_state_gives_the_state() -> None:
    (dlo,) = extrapolate(state(), 0)
    np.testing.assert_allclose(dlo.nodes, points(), atol=1e-4)
    np.testing.assert_allclose(dlo.sigma_px, 0.5)
