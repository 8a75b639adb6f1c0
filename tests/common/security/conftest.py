"""A folder of certificates made at a fixed time; nothing here reads a clock."""

from __future__ import annotations

from datetime import UTC, datetime
from pathlib import Path

import pytest

from motiondlo.security.certificates import init, issue_holder
from motiondlo.security.folder import CertificateFolder

NOW = datetime(2030, 5, 1, 12, 0, tzinfo=UTC)


@pytest.fixture
def folder(tmp_path: Path) -> CertificateFolder:
    """An authority, the gate's pair, and one pair per kind of visitor."""
    made = CertificateFolder(tmp_path / "certs")
    init(made, "cell1", NOW)
    issue_holder(made, "daemon", "", NOW, hosts=("localhost", "127.0.0.1"))
    issue_holder(made, "monitor", "", NOW)
    issue_holder(made, "gateway", "plc", NOW)
    return made
