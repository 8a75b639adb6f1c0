"""The process table: one row a daemon; systemd units, ``motiondlo run`` and the documentation follow it.

Topics are named as in :mod:`motiondlo.topics`; a test checks that both tables agree, and that every unit under
``deploy/systemd`` has its row's scheduling, watchdog and command.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum


class Scheduling(StrEnum):
    """How the kernel schedules a daemon, where it is permitted."""

    FIFO = "fifo"
    """SCHED_FIFO: runs before everything that is not real-time; for the event path only."""
    OTHER = "other"
    """The normal time-sharing class."""


@dataclass(frozen=True)
class Process:
    """One daemon."""

    name: str
    module: str
    """Module whose ``main()`` is the entry point ``motiondlo-<name>``."""
    purpose: str
    reads: tuple[str, ...]
    writes: tuple[str, ...]
    scheduling: Scheduling
    priority: int
    """SCHED_FIFO priority, or 0."""
    nice: int
    """Niceness under the normal class."""
    own_processor: bool
    """Its computing thread has a processor to itself, where there are two or more."""
    watchdog_s: int
    """The daemon tells systemd that it is alive at least twice in this time."""
    section: str
    """Its section in the cell's configuration."""
    paper: str
    """The part of the paper that it carries out."""
    in_mesh: bool = True
    """It listens within the cell, and its peers connect to it."""
    standby: bool = False
    """A second process of it waits, loaded and warm, and takes over within milliseconds when the first one ends."""


# Of the event path, who comes later goes first: with the ingest before all others, a burst whose decoding took all of a
# processor kept fusion and the tracker's receiving threads from running, and the state came 400 ms late (now 50 to 80).
PROCESSES: tuple[Process, ...] = (
    Process(
        name="event-ingest",
        module="motiondlo_services.event_ingest.daemon",
        purpose="decodes events and triggers and cuts them into batches on a fixed time grid",
        reads=("health", "state"),
        writes=("events/batch", "events/trigger", "events/clock", "health", "alive"),
        scheduling=Scheduling.FIFO,
        priority=40,
        nice=0,
        own_processor=False,
        watchdog_s=5,
        section="event_ingest",
        paper="Event Branch: batches; Time synchronization",
        standby=True,
    ),
    Process(
        name="event-tracker",
        module="motiondlo_services.event_tracker.daemon",
        purpose="moves every DLO's nodes with the events, and absorbs late corrections",
        reads=("events/batch", "correction", "command"),
        writes=("track", "health", "alive"),
        scheduling=Scheduling.FIFO,
        priority=41,
        nice=0,
        own_processor=True,
        watchdog_s=5,
        section="event_tracker",
        paper="Event Branch; CPD Tracker",
        standby=True,
    ),
    Process(
        name="fusion",
        module="motiondlo_services.fusion.daemon",
        purpose="publishes the state; asks for segmentations; turns them into corrections",
        reads=("track", "segmentation", "command"),
        writes=("state", "correction", "command", "health", "alive"),
        scheduling=Scheduling.FIFO,
        priority=42,
        nice=0,
        own_processor=False,
        watchdog_s=5,
        section="fusion",
        paper="Fusion Mechanism; Hibernation and Re-initialization",
        standby=True,
    ),
    Process(
        name="frame-capture",
        module="motiondlo_services.frame_capture.daemon",
        purpose="pairs frames with triggers and hands out the one that is asked for",
        reads=("events/trigger", "events/clock", "command"),
        writes=("frame", "health", "alive"),
        scheduling=Scheduling.OTHER,
        priority=0,
        nice=5,
        own_processor=False,
        watchdog_s=10,
        section="frame_capture",
        paper="Time synchronization",
    ),
    Process(
        name="segmenter",
        module="motiondlo_services.segmenter.daemon",
        purpose="finds the DLOs in a frame and fits their polylines",
        reads=("frame", "command"),
        writes=("segmentation", "health", "alive"),
        scheduling=Scheduling.OTHER,
        priority=0,
        nice=10,
        own_processor=False,
        watchdog_s=60,
        section="segmenter",
        paper="Frame Branch: SAM 3 Segmentation, Binary Mask Generation, Polyline fitting",
    ),
    Process(
        name="gate",
        module="motiondlo_services.gate.daemon",
        purpose="the only way in from outside: TLS, certificates, access control",
        reads=("state", "health"),
        writes=("health", "alive"),
        scheduling=Scheduling.OTHER,
        priority=0,
        nice=0,
        own_processor=False,
        watchdog_s=10,
        section="gate",
        paper="",
        in_mesh=False,
    ),
)


def process(name: str) -> Process:
    """The row of a daemon. Raises KeyError for a name that is not in the table."""
    for row in PROCESSES:
        if row.name == name:
            return row
    raise KeyError(name)
