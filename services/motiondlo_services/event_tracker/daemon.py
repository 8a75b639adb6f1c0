"""The event tracker's shell: batches and corrections in, a track message per update out."""

from __future__ import annotations

import sys
import time
from collections.abc import Iterable

from motiondlo.bus.session import Bus
from motiondlo.messages.correction import CorrectionMessage
from motiondlo.messages.events import EventBatchMessage
from motiondlo.messages.track import TrackMessage
from motiondlo.rejects import RejectReason
from motiondlo.topics import CORRECTION, EVENTS_BATCH, TRACK
from motiondlo.tracking.factory import make_tracker, warm_up
from motiondlo_services.event_tracker.config import EventTrackerConfig
from motiondlo_services.event_tracker.core import EventTrackerCore
from motiondlo_services.event_tracker.inheritance import Inheritance
from motiondlo_services.event_tracker.kept_regions import KeptRegions, state_folder
from motiondlo_services.event_tracker.regions import VERBS, RefusedError, running_config, screening_of, set_region
from motiondlo_services.runtime.shell import Shell, run_daemon

WAIT_S = 0.1


def load_kernels(shell: Shell) -> None:
    """Compile, or load from the cache, all that an update and its messages need."""
    config = shell.section(EventTrackerConfig)
    warm_up(config.profile, config.parameters, shell.cell.geometry)
    EventBatchMessage.prepare()


def serve(shell: Shell, bus: Bus) -> None:
    """Track until told to stop."""
    # Configuration and core.
    config = shell.section(EventTrackerConfig)
    tracker = make_tracker(config.profile, config.parameters, shell.cell.geometry)
    screening = screening_of(tracker)
    kept = KeptRegions(state_folder(shell.cell.state_folder), shell.cell.cell.name)
    if screening is not None:
        screening.set_regions(kept.applied_to(config.regions))
    core = EventTrackerCore(
        tracker,
        config.patience,
        config.most_merged,
        config.most_waiting,
        config.most_events,
    )

    # Bus.
    batches = bus.subscriber(EVENTS_BATCH, queue=max(config.most_waiting - config.most_merged, 1))
    corrections = bus.subscriber(CORRECTION)
    tracks = bus.publisher(TRACK)
    commands = bus.serve(VERBS)
    inheritance = Inheritance(time.monotonic_ns())
    shell.ready()

    def take(messages: Iterable[CorrectionMessage]) -> bool:
        taken = list(messages)
        for message in taken:
            core.on_correction(message.to_correction(), message.source)
        return bool(taken)

    # Loop: this thread receives and computes, so that nothing else competes for the interpreter.
    while shell.running:
        if not core.waiting:
            bus.wait(WAIT_S, batches, corrections, commands)
        while (command := commands.take()) is not None:
            try:
                if command.request.verb == "set_region":
                    answer = set_region(screening, command.request.args)
                    kept.change(config.regions, {} if screening is None else screening.regions)
                    command.answer({**answer, "kept": kept.kept})
                else:
                    command.answer(running_config(screening, config.model_dump()))
            except RefusedError as refused:
                command.refuse(str(refused), refused.what_to_do)
        corrected = take(inheritance.due(time.monotonic_ns()))
        for correction in corrections.drain():
            wanted, superseded = inheritance.sort(correction, time.monotonic_ns())
            for old in superseded:
                core.rejects.count(RejectReason.SUPERSEDED, old.source)
            corrected = take(wanted) or corrected or bool(superseded)
        # No more is decoded than one publication takes: what waits behind it may be dropped without any work, and
        # batches that take longer to read than to arrive must not keep this loop from tracking.
        while core.waiting < config.most_merged and (message := batches.recv()) is not None:
            # The first one of an ingest says only that it is there.
            if message.valid:
                core.push(message.to_batch(lost_on_the_way=batches.lost_before), message.t_ingest_ns)
        step = core.step()
        if step is not None:
            tracks.put(TrackMessage.from_update(step.update, step.t_ingest_ns, valid=step.whole))
            shell.t_us = batches.horizon_us = step.update.t_us
            shell.latency("update", time.monotonic_ns() - step.t_ingest_ns)
        changed = core.overloaded != (shell.lifecycle == "degraded")
        shell.lifecycle = "degraded" if core.overloaded else "running"
        overload = "more events than this machine can follow: some are left out" if core.overloaded else ""
        shell.problems = tuple(problem for problem in (overload, kept.problem) if problem)
        shell.take_over(core.counts)
        seen = screening.report() if screening is not None else {}
        shell.tick(
            {"tracks": core.tracks, "queue": core.waiting, **seen}, core.rejects.as_dict(), now=corrected or changed
        )


def main() -> int:
    """Entry point of ``motiondlo-event-tracker``."""
    return run_daemon("event-tracker", serve, prepare=load_kernels)


if __name__ == "__main__":
    sys.exit(main())
