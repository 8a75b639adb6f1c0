"""The table of commands: one row each; everything else about the command line derives from it.

A command's module has ``add_arguments(parser)`` and ``run(args) -> int``. It is imported when the command is called,
and imports what is heavy (numpy, numba, zenoh) inside ``run``. A name of two words is a command under another one, and
wins over a first argument of the shorter command.
"""

from __future__ import annotations

import importlib
from argparse import ArgumentParser, Namespace
from dataclasses import dataclass
from typing import Protocol, cast


class CommandModule(Protocol):
    """What a command's file provides."""

    def add_arguments(self, parser: ArgumentParser) -> None:
        """Declare the command's arguments."""
        ...

    def run(self, args: Namespace) -> int:
        """Do it; returns the exit code. Raises MotionDLOError for failures that a person can mend."""
        ...


@dataclass(frozen=True)
class Command:
    """One row."""

    name: str
    module: str
    summary: str

    def load(self) -> CommandModule:
        """Import the command's file."""
        return cast(CommandModule, importlib.import_module(self.module))


COMMANDS = (
    Command("demo", "motiondlo_services.commands.demo", "play the bundled recording through all the real daemons"),
    Command("run", "motiondlo_services.commands.run", "start a cell's daemons under one supervisor"),
    Command("record", "motiondlo_services.commands.record", "record a running cell"),
    Command("replay", "motiondlo_services.commands.replay", "play a recording back into a cell at real speed"),
    Command("track", "motiondlo.cli.track", "follow the DLOs through a recording, write tracks.npz"),
    Command("eval", "motiondlo.cli.eval", "errors of tracks against a recording's ground truth"),
    Command("bench", "motiondlo.cli.bench", "time per update and per stage on this machine"),
    Command("bench segmenter", "motiondlo.cli.bench_segmenter", "time per frame of a segmenter backend"),
    Command("bench live", "motiondlo_services.commands.bench_live", "end-to-end latency through the real daemons"),
    Command("calibrate homography", "motiondlo.cli.calibrate", "map from RGB to event pixels, with its residuals"),
    Command("calibrate lens", "motiondlo.cli.calibrate_lens", "a camera's lens from pictures of a board"),
    Command("simulate", "motiondlo.cli.simulate", "make a recording with exact truth from a scene"),
    Command("info", "motiondlo.cli.info", "summarise a recording or an events file"),
    Command("certs", "motiondlo.cli.certs", "make, list and renew the certificates of the gate and its visitors"),
    Command("doctor", "motiondlo_services.commands.doctor", "check this machine and a cell's configuration"),
)


def find_command(words: list[str], commands: tuple[Command, ...] = COMMANDS) -> tuple[Command, list[str]] | None:
    """The command that ``words`` begin with, and the words after it; None when there is none."""
    by_name = {command.name: command for command in commands}
    for length in (2, 1):
        command = by_name.get(" ".join(words[:length])) if len(words) >= length else None
        if command is not None:
            return command, words[length:]
    return None
