from __future__ import annotations

import os
import subprocess
import sys
import types

import pytest

from motiondlo.cli.commands import COMMANDS, Command, find_command
from motiondlo.cli.main import main
from motiondlo.errors import MotionDLOError


@pytest.fixture
def command(monkeypatch):
    """Make a table with one command ``do`` whose run does what it is told."""

    def make(behaviour):
        module = types.ModuleType("motiondlo_test_command")
        module.__doc__ = "Does something."
        module.add_arguments = lambda parser: parser.add_argument("what", nargs="?")
        module.run = behaviour
        monkeypatch.setitem(sys.modules, "motiondlo_test_command", module)
        return (Command("do", "motiondlo_test_command", "does something"),)

    return make


def _raise(error):
    def behaviour(args):
        raise error

    return behaviour


def test_exit_code_is_that_of_the_command(command):
    assert main(["do", "x"], command(lambda args: 0 if args.what == "x" else 1)) == 0


def test_failure_is_one_line_that_says_what_and_what_to_do(command, capsys):
    assert main(["do"], command(_raise(MotionDLOError("a.raw:\n no such file.", "Check the path.")))) == 1
    assert capsys.readouterr().err == "motiondlo: a.raw: no such file. Check the path.\n"


def test_unexpected_failure_is_one_line_as_well(command, capsys):
    assert main(["do"], command(_raise(ZeroDivisionError("by zero")))) == 1
    err = capsys.readouterr().err
    assert err.count("\n") == 1
    assert "ZeroDivisionError: by zero" in err
    assert "--debug" in err


@pytest.mark.parametrize("argv", [["--debug", "do"], ["do", "--debug"]])
def test_debug_shows_the_traceback(command, argv):
    with pytest.raises(MotionDLOError):
        main(argv, command(_raise(MotionDLOError("wrong."))))


def test_interrupt_is_clean(command, capsys):
    assert main(["do"], command(_raise(KeyboardInterrupt()))) == 130
    assert capsys.readouterr().err == "motiondlo: interrupted.\n"


@pytest.mark.parametrize("argv", [["--quiet", "do"], ["do", "--quiet"]])
def test_quiet_reaches_the_command_from_either_side(command, argv):
    assert main(argv, command(lambda args: 0 if args.quiet else 1)) == 0


@pytest.mark.parametrize("argv", [[], ["dance"], ["--nonsense"], ["do", "--nonsense"], ["do", "x", "y"]])
def test_wrong_usage_exits_with_two(command, argv):
    with pytest.raises(SystemExit) as caught:
        main(argv, command(lambda args: 0))
    assert caught.value.code == 2


def test_misspelt_command_gets_a_hint(capsys):
    with pytest.raises(SystemExit):
        main(["trakc"])
    assert "did you mean track?" in capsys.readouterr().err


TWO_WORDS = (Command("bench", "a", ""), Command("bench live", "b", ""), Command("calibrate homography", "c", ""))


def test_two_words_win_over_one():
    assert find_command(["bench", "live", "x"], TWO_WORDS) == (TWO_WORDS[1], ["x"])
    assert find_command(["bench", "./live"], TWO_WORDS) == (TWO_WORDS[0], ["./live"])
    assert find_command(["calibrate"], TWO_WORDS) is None


def test_first_word_alone_names_what_may_follow(capsys):
    with pytest.raises(SystemExit):
        main(["calibrate"], TWO_WORDS)
    assert "homography" in capsys.readouterr().err


@pytest.mark.parametrize("command_row", COMMANDS, ids=lambda row: row.name)
def test_every_command_of_the_table_explains_itself(command_row, capsys):
    with pytest.raises(SystemExit) as caught:
        main([*command_row.name.split(), "--help"])
    assert caught.value.code == 0
    assert "--debug" in capsys.readouterr().out


def test_help_lists_every_command_and_imports_nothing_heavy():
    code = (
        "import sys\n"
        "from motiondlo.cli.main import main\n"
        "try:\n    main(['--help'])\nexcept SystemExit as end:\n    assert end.code == 0\n"
        "heavy = {'numpy', 'numba', 'cv2', 'zenoh', 'rich', 'pydantic', 'matplotlib'} & set(sys.modules)\n"
        "assert not heavy, heavy\n"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=20, check=False)
    assert done.returncode == 0, done.stderr
    for command_row in COMMANDS:
        assert f"  {command_row.name} " in done.stdout


def test_reader_that_went_away_is_no_traceback():
    code = (
        "import sys, types\n"
        "from motiondlo.cli.commands import Command\n"
        "from motiondlo.cli.main import main\n"
        "module = types.ModuleType('talks')\n"
        "module.add_arguments = lambda parser: None\n"
        "module.run = lambda args: print('into the void') or 0\n"
        "sys.modules['talks'] = module\n"
        "sys.exit(main(['talk'], (Command('talk', 'talks', ''),)))\n"
    )
    read_end, write_end = os.pipe()
    os.close(read_end)
    try:
        done = subprocess.run(
            [sys.executable, "-c", code], stdout=write_end, stderr=subprocess.PIPE, text=True, timeout=20, check=False
        )
    finally:
        os.close(write_end)
    assert (done.returncode, done.stderr) == (1, "")
