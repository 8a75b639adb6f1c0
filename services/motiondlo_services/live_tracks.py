"""States that a subscriber received, as the rows of a tracks file."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from motiondlo.messages.state import StateMessage
from motiondlo.offline.tracks import Tracks, TracksBuilder


def tracks_of(states: Iterable[StateMessage]) -> Tracks:
    """One row per DLO and state, in time order; a state that steps back in time (a restart) is left out."""
    builder = TracksBuilder()
    newest_us = -1
    for state in states:
        if state.t_us < newest_us:
            continue
        newest_us = state.t_us
        for dlo in state.dlos:
            builder.add(state.t_us, dlo.id, dlo.nodes.astype(np.float64), dlo.sigma_px.astype(np.float64), dlo.source)
    return builder.build()
