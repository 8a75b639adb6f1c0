"""The fused state as the state message, also when nothing comes in; segmentations held back in a replay."""

from __future__ import annotations

import time
from collections import deque
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from motiondlo.frames.types import Segmentation
from motiondlo.fusion.state import FusedDlo, FusedState
from motiondlo.geometry.work_plane import WorkPlane
from motiondlo.messages.header import trusted
from motiondlo.messages.state import StateDlo, StateMessage
from motiondlo_services.runtime.shell import HEALTH_PERIOD_NS

Float32Array = npt.NDArray[np.float32]

SILENT_NS = 200_000_000
"""Batches come every few milliseconds: after so long their source is gone."""


def state_message(state: FusedState, t_ingest_ns: int, work_plane: WorkPlane | None) -> StateMessage:
    """The message of a state; our own arrays are not validated again (this runs a thousand times a second)."""
    return trusted(
        StateMessage,
        {
            "t_us": state.t_us,
            "t_events_us": state.t_events_us,
            "t_utc_ns": time.time_ns(),
            "t_ingest_ns": t_ingest_ns,
            "mode": state.mode.value,
            "dlos": tuple(_dlo(dlo, work_plane) for dlo in state.dlos),
        },
    )


def _dlo(dlo: FusedDlo, work_plane: WorkPlane | None) -> StateDlo:
    return trusted(
        StateDlo,
        {
            "id": dlo.id,
            "nodes": _single(dlo.nodes),
            "sigma_px": _single(dlo.sigma_px),
            "velocity_px_s": _single(dlo.velocity_px_s),
            "visible": np.asarray(dlo.visible, dtype=np.uint8),
            "diameter_px": float(dlo.diameter_px),
            "length_px": float(dlo.length_px),
            "confidence": float(dlo.confidence),
            "moving": bool(dlo.moving),
            "source": str(dlo.source),
            "t_corrected_us": int(dlo.t_corrected_us),
            "nodes_mm": None if work_plane is None else _single(work_plane.mm(dlo.nodes)),
        },
    )


def _single(array: npt.NDArray[np.float64]) -> Float32Array:
    return np.ascontiguousarray(array, dtype=np.float32)


@dataclass(frozen=True)
class Asked:
    """What is remembered of a request."""

    number: int
    """Fusion's own number of it."""
    t_us: int
    """Event time at which it was made, -1 for the first frame's."""


class SegmentationHold:
    """Keeps segmentations until event time has come to where a segmenter of the given latency would deliver them.

    A replay on a machine whose segmenter is faster then gives what ``motiondlo track`` gives. With a latency of 0 (any
    live cell) everything is released at once; so is the first frame's, whose scene was at rest before the start.
    """

    def __init__(self, latency_us: int) -> None:
        self._latency_us = latency_us
        self._held: deque[tuple[int, int, Segmentation]] = deque()

    def put(self, segmentation: Segmentation, asked: Asked) -> None:
        """``asked``: the request that this one answers."""
        due_us = -1
        if asked.t_us >= 0 and self._latency_us:
            due_us = max(asked.t_us, segmentation.t_us) + self._latency_us
        self._held.append((due_us, asked.number, segmentation))

    def due(self, now_us: int) -> list[tuple[Segmentation, int]]:
        """Those whose time has come, with the numbers of their requests."""
        released = []
        while self._held and self._held[0][0] <= now_us:
            _, number, segmentation = self._held.popleft()
            released.append((segmentation, number))
        return released


class Silence:
    """When the last state is to be sent again because no track update comes: soon, then at the rate of health.

    For live cells: a recording that has ended, or is played slowly, is silent too, and nothing is missing.
    """

    def __init__(self, live: bool, after_ns: int = SILENT_NS, every_ns: int = HEALTH_PERIOD_NS) -> None:
        self._after_ns, self._every_ns = after_ns, every_ns
        self._live = live
        self._since_ns = self._next_ns = 0

    def broken(self, now_ns: int) -> None:
        """A track update has come."""
        self._since_ns, self._next_ns = now_ns, now_ns + self._after_ns

    def due_us(self, now_ns: int) -> int:
        """For how long nothing has come, where that is to be said now; 0 otherwise."""
        if not self._live or not self._since_ns or now_ns < self._next_ns:
            return 0
        self._next_ns = now_ns + self._every_ns
        return (now_ns - self._since_ns) // 1000
