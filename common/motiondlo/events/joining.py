"""Join arrays of events; numpy joins structured arrays field by field, twenty times slower than their bytes."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from motiondlo.events.types import EventArray

_RAW = np.dtype("V16")


def join(parts: Sequence[EventArray]) -> EventArray:
    """All ``parts`` (at least one; contiguous arrays of EVENT_DTYPE, or all of TRIGGER_DTYPE) in one new array."""
    return np.concatenate([part.view(_RAW) for part in parts]).view(parts[0].dtype)
