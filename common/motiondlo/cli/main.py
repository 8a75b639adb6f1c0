"""``motiondlo``: find the command, run it, turn failures into exit codes.

0 done, 1 failed (one line says what, and what to do), 2 wrong usage, 130 interrupted.
"""

from __future__ import annotations

import os
import sys
from argparse import ArgumentParser, Namespace, RawDescriptionHelpFormatter
from collections.abc import Sequence
from difflib import get_close_matches
from typing import NoReturn

from motiondlo import __version__
from motiondlo.cli.commands import COMMANDS, Command, find_command
from motiondlo.errors import MotionDLOError

FAILED, INTERRUPTED = 1, 130


def main(argv: Sequence[str] | None = None, commands: tuple[Command, ...] = COMMANDS) -> int:
    """Run the command line; returns the exit code (wrong usage exits with 2 through SystemExit)."""
    # Small matrices: a second BLAS thread only fights for the cores. numpy reads this when it is first imported.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    words = list(sys.argv[1:] if argv is None else argv)
    leading = []
    while words and words[0].startswith("-"):
        leading.append(words.pop(0))
    parser = _top_parser(commands)
    options = parser.parse_args(leading)
    found = find_command(words, commands)
    if found is None:
        _refuse(parser, words, commands)
    command, rest = found
    module = command.load()
    command_parser = ArgumentParser(
        prog=f"motiondlo {command.name}",
        description=(module.__doc__ or command.summary).strip(),
        formatter_class=RawDescriptionHelpFormatter,
    )
    module.add_arguments(command_parser)
    _add_common(command_parser)
    args = command_parser.parse_args(rest)
    args.debug |= options.debug
    args.quiet |= options.quiet
    return _guarded(command, args)


def _guarded(command: Command, args: Namespace) -> int:
    try:
        code = command.load().run(args)
        sys.stdout.flush()
        return code
    except KeyboardInterrupt:
        print("motiondlo: interrupted.", file=sys.stderr)
        return INTERRUPTED
    except BrokenPipeError:
        # The reader of our output (head, less) has gone; silence the flush at exit as well.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return FAILED
    except MotionDLOError as error:
        if args.debug:
            raise
        print(f"motiondlo: {_one_line(str(error))}", file=sys.stderr)
        return FAILED
    except Exception as error:
        if args.debug:
            raise
        what = _one_line(f"{type(error).__name__}: {error}")
        print(
            f"motiondlo: unexpected failure ({what}). Run it again with --debug and report what it prints.",
            file=sys.stderr,
        )
        return FAILED


def _top_parser(commands: tuple[Command, ...]) -> ArgumentParser:
    width = max(len(command.name) for command in commands)
    listing = "\n".join(f"  {command.name:<{width}}  {command.summary}" for command in commands)
    parser = ArgumentParser(
        prog="motiondlo",
        usage="motiondlo [--version] [--debug] [--quiet] COMMAND ...",
        description="Track cables, hoses and wires with an event camera and an RGB camera.",
        epilog=f"commands:\n{listing}\n\nmotiondlo COMMAND --help says more about one.",
        formatter_class=RawDescriptionHelpFormatter,
    )
    parser.add_argument("--version", action="version", version=f"motiondlo {__version__}")
    _add_common(parser)
    return parser


def _add_common(parser: ArgumentParser) -> None:
    parser.add_argument("--debug", action="store_true", help="show the traceback of a failure")
    parser.add_argument("--quiet", action="store_true", help="no progress, no tables; errors only")


def _refuse(parser: ArgumentParser, words: list[str], commands: tuple[Command, ...]) -> NoReturn:
    if not words:
        parser.error("which command? (motiondlo --help lists them)")
    below = [command.name for command in commands if command.name.startswith(f"{words[0]} ")]
    if below:
        parser.error(f"{words[0]} needs one of: {', '.join(name.split()[1] for name in below)}")
    near = get_close_matches(words[0], [command.name for command in commands], n=1)
    hint = f"did you mean {near[0]}?" if near else "motiondlo --help lists them"
    parser.error(f"there is no command {words[0]!r} ({hint})")


def _one_line(text: str) -> str:
    return " ".join(text.split())
