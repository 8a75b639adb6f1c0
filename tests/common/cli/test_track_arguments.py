from __future__ import annotations

from argparse import ArgumentParser

import pytest

from motiondlo.cli.main import main
from motiondlo.cli.track_arguments import add_loop_arguments, options_of
from motiondlo.offline.options import TrackMode, TrackOptions


def _parse(*argv):
    parser = ArgumentParser()
    add_loop_arguments(parser)
    return parser.parse_args(argv)


def test_no_arguments_are_the_default_options():
    assert options_of(_parse(), "default") == TrackOptions(tracker={}, fusion={}, frames={})


def test_arguments_become_options():
    args = _parse("--mode", "event", "--update-us", "500", "--segmenter-latency-ms", "50.5", "--set", "tracker.a=1")
    options = options_of(args, "paper")
    assert (options.profile, options.mode, options.update_us) == ("paper", TrackMode.EVENT, 500)
    assert (options.segmenter_latency_ms, options.tracker) == (50.5, {"a": 1})


@pytest.mark.parametrize(
    "argv",
    [
        ["--mode", "radar"],
        ["--update-us", "0"],
        ["--update-us", "1.5"],
        ["--segmenter-latency-ms", "-1"],
        ["--segmenter-latency-ms", "nan"],
        ["--segmenter-latency-ms", "soon"],
    ],
)
def test_wrong_value_is_wrong_usage(argv):
    with pytest.raises(SystemExit) as caught:
        _parse(*argv)
    assert caught.value.code == 2


def test_place_that_cannot_be_written_is_told_before_the_work(tmp_path, capsys):
    assert main(["track", str(tmp_path), "--out", str(tmp_path / "absent" / "t.npz")]) == 1
    assert "no folder" in capsys.readouterr().err
    assert main(["track", str(tmp_path), "--out", str(tmp_path / "t.npz")]) == 1
    assert "events.raw" in capsys.readouterr().err
