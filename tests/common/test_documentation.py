"""What the documentation points at is there, and what it quotes is what is shipped."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_every_link_leads_somewhere(page: Path) -> None:
    links = re.findall(r"\]\(([^)#\s]+)\)", page.read_text(encoding="utf-8"))
    missing = [link for link in links if "://" not in link and not (page.parent / link).exists()]
    assert missing == []


def test_the_quoted_subscriber_is_the_example() -> None:
    example = (ROOT / "examples" / "plain_subscriber.py").read_text(encoding="utf-8").rstrip()
    assert example in (ROOT / "README.md").read_text(encoding="utf-8")


def test_the_readmes_state_table_names_every_key() -> None:
    from motiondlo.messages.state import StateDlo, StateMessage

    text = (ROOT / "README.md").read_text(encoding="utf-8")
    wire = {"schema"} | (set(StateMessage.model_fields) - {"schema_major", "source", "valid"})
    for key in wire | set(StateDlo.model_fields):
        assert f"`{key}`" in text, key
