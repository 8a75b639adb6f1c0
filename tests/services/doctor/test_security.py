"""The doctor on who could get in."""

from __future__ import annotations

from datetime import UTC, datetime, timedelta
from pathlib import Path

import pytest

from motiondlo.config.cell import load_cell
from motiondlo.security.certificates import init, issue_holder
from motiondlo.security.folder import CertificateFolder
from motiondlo_services.cell_config import bus_section
from motiondlo_services.doctor.findings import Verdict
from motiondlo_services.doctor.security import check_security


@pytest.fixture
def certs(tmp_path: Path) -> CertificateFolder:
    folder = CertificateFolder(tmp_path / "certs")
    init(folder, "cell", datetime.now(UTC))
    issue_holder(folder, "daemon", "", datetime.now(UTC), hosts=("localhost",))
    return folder


def findings(tmp_path: Path, text: str) -> dict[str, tuple[Verdict, str]]:
    config = tmp_path / "cell.toml"
    config.write_text(text, encoding="utf-8")
    shared_memory = tmp_path / "shm"
    shared_memory.mkdir(exist_ok=True)
    found = check_security(load_cell(config), bus_section(config), shared_memory)
    assert all((entry.verdict == Verdict.OK) == (entry.what_to_do == "") for entry in found)
    return {entry.subject: (entry.verdict, entry.what) for entry in found}


GATE = '[gate]\nenabled = true\nlisten = "tls/127.0.0.1:0"\n'


def test_without_a_gate_nothing_is_asked_for(tmp_path: Path) -> None:
    assert {verdict for verdict, _ in findings(tmp_path, "").values()} == {Verdict.OK}


def test_a_gate_with_good_certificates_is_fine(tmp_path: Path, certs: CertificateFolder) -> None:
    assert {verdict for verdict, _ in findings(tmp_path, GATE).values()} == {Verdict.OK}


def test_a_gate_without_certificates_fails(tmp_path: Path) -> None:
    assert findings(tmp_path, GATE)["certificates"][0] == Verdict.FAILURE


def test_an_open_key_and_another_cells_certificates_fail(tmp_path: Path, certs: CertificateFolder) -> None:
    verdict, what = findings(tmp_path, GATE + '[cell]\nname = "other"\n')["certificates"]
    assert verdict == Verdict.FAILURE
    assert "'cell'" in what
    certs.key("daemon").chmod(0o644)
    verdict, what = findings(tmp_path, GATE)["certificates"]
    assert verdict == Verdict.FAILURE
    assert "open to others" in what


def test_expiry_is_warned_of(tmp_path: Path, certs: CertificateFolder) -> None:
    certs.certificate("daemon").unlink()
    certs.key("daemon").unlink()
    issue_holder(certs, "daemon", "", datetime.now(UTC) - timedelta(days=1), days=20, hosts=("localhost",))
    assert findings(tmp_path, GATE)["certificates"][0] == Verdict.WARNING


def test_an_open_socket_folder_and_open_segments_fail(tmp_path: Path) -> None:
    run = tmp_path / "run"
    run.mkdir(mode=0o700)
    text = f'[bus]\nsocket_folder = "{run}"\n'
    assert findings(tmp_path, text)["sockets"][0] == Verdict.OK
    run.chmod(0o755)
    (tmp_path / "shm" / "1.zenoh").touch()
    (tmp_path / "shm" / "1.zenoh").chmod(0o644)
    found = findings(tmp_path, text)
    assert found["sockets"][0] == Verdict.FAILURE
    assert found["shared memory access"][0] == Verdict.FAILURE
