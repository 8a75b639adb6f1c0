"""``command/reset``, ``command/pause`` and ``command/resume``, as fusion carries them out. No clock."""

from __future__ import annotations

from motiondlo.bus.commands import PendingCommand
from motiondlo.fusion.core import FusionCore
from motiondlo.messages.command import Verb
from motiondlo.tracking.types import Correction

VERBS: tuple[Verb, ...] = ("reset", "pause", "resume")


def carry_out(command: PendingCommand, core: FusionCore) -> tuple[Correction, ...]:
    """Do what ``command`` says and answer it; corrections for the tracker."""
    if command.request.verb == "reset":
        retired = core.reset()
        command.answer({"retired": tuple(correction.id for correction in retired)})
        return retired
    core.pause(command.request.verb == "pause")
    command.answer({"paused": core.paused})
    return ()
