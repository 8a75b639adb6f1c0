"""``motiondlo bench segmenter``: figures per stage, and complaints that help."""

from __future__ import annotations

import json
from pathlib import Path

import cv2
import numpy as np
import pytest

from motiondlo.cli.main import main
from motiondlo.frames.sam3_weights import missing_packages


@pytest.fixture
def picture(tmp_path: Path) -> str:
    image = np.random.default_rng(2).integers(200, 215, (243, 324, 3)).astype(np.uint8)
    cv2.line(image, (40, 120), (280, 125), (20, 20, 140), 8)
    assert cv2.imwrite(str(tmp_path / "p.png"), image)
    return str(tmp_path / "p.png")


def test_every_stage_is_timed_at_the_wanted_width(picture: str, tmp_path: Path, capsys) -> None:
    out = tmp_path / "f.json"
    assert main(["bench", "segmenter", picture, "--width-px", "648", "--repeats", "2", "--json", str(out)]) == 0
    figures = json.loads(out.read_text())
    assert figures["backend"] == "classical"
    assert figures["image_px"] == [648, 486]
    assert figures["outcome"] == "1 instances"
    assert figures["total_ms"]["max"] >= figures["total_ms"]["p50"] > 0.0
    parts = sum(values["p50"] for values in figures["stages_ms"].values())
    assert parts == pytest.approx(figures["total_ms"]["p50"], rel=0.3)
    assert "refine" in capsys.readouterr().out


@pytest.mark.skipif(bool(missing_packages()), reason=f"extra sam3 is not installed: {', '.join(missing_packages())}")
def test_sam3_with_random_weights_needs_no_download(picture: str, tmp_path: Path) -> None:
    out = tmp_path / "f.json"
    words = ["bench", "segmenter", picture, "--backend", "sam3", "--random-weights", "tiny", "--repeats", "1"]
    assert main([*words, "--set", "frames.sam3.device=cpu", "--json", str(out)]) == 0
    figures = json.loads(out.read_text())
    assert {"segment.resize", "segment.vision", "segment.prompts"} <= set(figures["stages_ms"])
    assert "cpu, float32" in figures["runs_on"]


@pytest.mark.parametrize(
    ("words", "complaint"),
    [
        (["--random-weights"], "has no random weights"),
        (["--backend", "magic"], "Choose one of"),
        (["--backend", "onnx"], "no such file"),
        (["--set", "frames.sam3.min_score=2"], "no such field"),
    ],
)
def test_what_cannot_be_timed_is_one_line(picture: str, words: list[str], complaint: str, capsys) -> None:
    assert main(["bench", "segmenter", picture, *words]) == 1
    assert complaint in capsys.readouterr().err
    assert main(["bench", "segmenter", "/does/not/exist.png"]) == 1
