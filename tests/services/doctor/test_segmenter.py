"""The doctor about backends: packages, weights, device."""

from __future__ import annotations

from pathlib import Path

import pytest

from motiondlo.bundled import bundled_recording
from motiondlo.config.cell import load_cell
from motiondlo.frames.sam3_weights import missing_packages
from motiondlo_services.doctor.findings import Finding, Verdict
from motiondlo_services.doctor.segmenter import check_segmenter
from motiondlo_services.replay_cell import write_replay_cell


@pytest.fixture
def findings(tmp_path: Path):
    """Findings of a cell with these lines in its configuration, by subject."""

    def look(lines: str) -> dict[str, Finding]:
        path = write_replay_cell(tmp_path / "c.toml", bundled_recording())
        path.write_text(path.read_text() + lines, encoding="utf-8")
        found = {finding.subject: finding for finding in check_segmenter(load_cell(path))}
        assert all((f.verdict == Verdict.OK) == (f.what_to_do == "") for f in found.values())
        return found

    return look


@pytest.fixture
def weights(tmp_path: Path) -> Path:
    """A folder with files of the right names, beside the configuration."""
    folder = tmp_path / "weights"
    folder.mkdir()
    for name in ("config.json", "model.safetensors", "tokenizer.json"):
        (folder / name).write_bytes(b"{}")
    return folder


def test_weights_are_found_in_a_folder_beside_the_configuration(findings, weights) -> None:
    lines = '[segmenter]\nbackend = "sam3"\n[segmenter.sam3]\nmodel = "weights"\n'
    assert findings(lines)["segmenter weights"].verdict == Verdict.OK
    (weights / "model.safetensors").write_bytes(b"")
    found = findings(lines)["segmenter weights"]
    assert found.verdict == Verdict.FAILURE
    assert "safetensors" in found.what
    assert "hf download" in found.what_to_do


def test_weights_that_nobody_downloaded_are_missed(findings) -> None:
    found = findings('[segmenter]\nbackend = "sam3"\n[segmenter.sam3]\nmodel = "nobody/nothing"\n')["segmenter weights"]
    assert found.verdict == Verdict.FAILURE
    assert "hf auth login" in found.what_to_do


def test_packages_that_are_missing_or_too_old_are_named(findings, weights, monkeypatch) -> None:
    lines = '[segmenter]\nbackend = "sam3"\n[segmenter.sam3]\nmodel = "weights"\n'
    module = "motiondlo_services.doctor.segmenter"
    monkeypatch.setattr(f"{module}.missing_packages", lambda: ("torch",))
    found = findings(lines)["segmenter packages"]
    assert (found.verdict, found.what) == (Verdict.FAILURE, "backend sam3 needs torch")
    assert "motiondlo[sam3]" in found.what_to_do
    monkeypatch.setattr(f"{module}.missing_packages", lambda: ())
    monkeypatch.setattr(f"{module}.package_versions", lambda: {"torch": "2.13.0", "transformers": "4.57.0"})
    assert findings(lines)["segmenter packages"].verdict == Verdict.FAILURE


@pytest.mark.skipif(bool(missing_packages()), reason=f"extra sam3 is not installed: {', '.join(missing_packages())}")
def test_the_device_is_judged(findings, weights) -> None:
    lines = '[segmenter]\nbackend = "sam3"\n[segmenter.sam3]\nmodel = "weights"\ndevice = "{}"\n'
    assert findings(lines.format("cpu"))["segmenter device"].verdict == Verdict.WARNING
    assert findings(lines.format("cuda:63"))["segmenter device"].verdict == Verdict.FAILURE


def test_an_onnx_file_is_looked_for_and_tried(findings, tmp_path) -> None:
    pytest.importorskip("onnxruntime", reason="onnxruntime is not installed (extra onnx)")
    lines = '[segmenter]\nbackend = "onnx"\n[segmenter.onnx]\nmodel = "m.onnx"\n'
    assert findings(lines)["segmenter weights"].verdict == Verdict.FAILURE
    (tmp_path / "m.onnx").write_bytes(b"no model")
    found = findings(lines)
    assert found["segmenter weights"].verdict == Verdict.OK
    assert found["segmenter"].verdict == Verdict.FAILURE


def test_onnx_without_its_package_says_how_to_install_it(findings, monkeypatch) -> None:
    def absent(name: str) -> None:
        return None

    monkeypatch.setattr("motiondlo_services.doctor.segmenter.importlib.util.find_spec", absent)
    found = findings('[segmenter]\nbackend = "onnx"\n')["segmenter packages"]
    assert found.verdict == Verdict.FAILURE
    assert "motiondlo[onnx]" in found.what_to_do


def test_a_folder_to_replay_that_is_missing_is_found(findings, tmp_path) -> None:
    lines = '[segmenter]\nbackend = "replay"\nreplay_folder = "masks"\n'
    assert findings(lines)["segmenter"].verdict == Verdict.FAILURE
    (tmp_path / "masks").mkdir()
    assert findings(lines)["segmenter"].verdict == Verdict.OK
