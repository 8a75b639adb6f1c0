"""The fusion daemon's shell: tracks and segmentations in; the state, requests and corrections out."""

from __future__ import annotations

import sys
import time

from motiondlo.bus.publisher import Publisher
from motiondlo.bus.session import Bus
from motiondlo.frames.types import Segmentation
from motiondlo.fusion.core import FusionCore
from motiondlo.messages.correction import CorrectionMessage
from motiondlo.messages.track import TrackMessage
from motiondlo.topics import CORRECTION, SEGMENTATION, STATE, TRACK
from motiondlo.tracking.types import Correction
from motiondlo_services.fusion.asking import FrameAsker
from motiondlo_services.fusion.commands import VERBS, carry_out
from motiondlo_services.fusion.config import FusionConfig
from motiondlo_services.fusion.publication import Asked, SegmentationHold, Silence, state_message
from motiondlo_services.runtime.shell import Shell, run_daemon

WAIT_S = 0.05
MOST_ASKED = 4
"""Requests whose answers are taken: the newest, and those before it that were cancelled."""


def serve(shell: Shell, bus: Bus) -> None:
    """Fuse until told to stop."""
    # Configuration and core. Corrections number on from the host's clock, so that a restart never repeats a number.
    core = FusionCore(shell.section(FusionConfig), first_seq=time.monotonic_ns() // 1000)
    work_plane = shell.cell.work_plane()
    replay = shell.cell.replay
    hold = SegmentationHold(int(replay.segmenter_latency_ms * 1000) if replay.recording else 0)

    # Bus.
    tracks = bus.subscriber(TRACK)
    segmentations = bus.subscriber(SEGMENTATION)
    states = bus.publisher(STATE)
    corrections = bus.publisher(CORRECTION)
    commands = bus.serve(VERBS)
    asker = FrameAsker(bus)
    asked: dict[str, Asked] = {}
    now_us, degraded, started_ns = -1, "", time.monotonic_ns()
    live, t_ingest_ns = not replay.recording, 0
    silence = Silence(live)
    shell.ready()

    def on_track(message: TrackMessage) -> None:
        state = core.on_track(message.to_update(), message.valid)
        states.put(state_message(state, message.t_ingest_ns, work_plane))
        shell.latency("state", time.monotonic_ns() - message.t_ingest_ns)
        shell.counts["states"] += 1
        _send(corrections, core.corrections_due(), shell)

    # Loop.
    while shell.running:
        bus.wait(WAIT_S, tracks, segmentations, commands)
        while (command := commands.take()) is not None:
            _send(corrections, carry_out(command, core), shell)
        for track in tracks.drain():
            on_track(track)
            now_us, t_ingest_ns = track.t_us, track.t_ingest_ns
            shell.t_us = now_us
            silence.broken(time.monotonic_ns())
        silent_us = silence.due_us(time.monotonic_ns())
        if silent_us and (last := core.silent(silent_us)) is not None:
            states.put(state_message(last, t_ingest_ns, work_plane))
            shell.counts["states_again"] += 1
        for segmentation in segmentations.drain():
            if segmentation.request_id in asked:
                hold.put(segmentation.to_segmentation(), asked.pop(segmentation.request_id))
                shell.counts["segmentations"] += 1
            else:
                shell.counts["segmentations_of_others"] += 1
        for due, number in hold.due(now_us):
            shell.counts["failed_segmentations"] += int(bool(due.failure))
            _send(corrections, core.on_segmentation(due, now_us, number), shell)
        if asker.failed():
            not_taken = Segmentation(now_us, "", failure=f"not taken: {asker.last_error}")
            core.on_segmentation(not_taken, now_us, asker.number)
        for number in core.withdrawn():
            # Not in a replay, which is to give what the offline run gives: there a late shape is used all the same.
            if live:
                for request_id in [key for key, of in asked.items() if of.number == number]:
                    asker.withdraw(request_id)
        request = core.frame_request((time.monotonic_ns() - started_ns) // 1000)
        if request is not None:
            request_id = f"fusion-{shell.counts['requests']}"
            # A cancelled request's answer may still come, and is as good as any.
            asked = dict(list(asked.items())[-(MOST_ASKED - 1) :])
            asked[request_id] = Asked(request.number, now_us if request.after_us >= 0 else -1)
            asker.ask(request, request_id)
            shell.counts["requests"] += 1
        shell.counts["cancelled_requests"] = core.cancelled
        if core.alignment is not None:
            shell.counts["homography_corrections"] = core.alignment.corrections
            shell.counts["homography_corrections_reverted"] = core.alignment.reverted
        for reason, count in core.rejects.as_dict().items():
            shell.counts[f"refused_{reason}"] = count
        changed, degraded = degraded != core.degraded_reason, core.degraded_reason
        shell.problems = (degraded,) if degraded else ()
        shell.tick({}, {}, now=changed)
    asker.close()


def _send(publisher: Publisher[CorrectionMessage], corrections: tuple[Correction, ...], shell: Shell) -> None:
    for correction in corrections:
        publisher.put(CorrectionMessage.from_correction(correction))
        shell.counts["corrections"] += 1


def main() -> int:
    """Entry point of ``motiondlo-fusion``."""
    return run_daemon("fusion", serve)


if __name__ == "__main__":
    sys.exit(main())
