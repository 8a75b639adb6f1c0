"""The process table and the topic table agree with each other, and the page is current."""

from __future__ import annotations

import importlib
import tomllib
from pathlib import Path

import pytest

from motiondlo.topics import TOPICS
from motiondlo_services.processes import PROCESSES, Process
from motiondlo_services.tables import page

ROOT = Path(__file__).resolve().parents[2]
NAMES = {topic.name for topic in TOPICS}


def test_the_page_is_current() -> None:
    current = (ROOT / "docs" / "tables.md").read_text(encoding="utf-8")
    assert current == page(), "python -m motiondlo_services.tables > docs/tables.md"


@pytest.mark.parametrize("row", PROCESSES, ids=lambda row: row.name)
def test_a_process_reads_and_writes_topics_that_there_are(row: Process) -> None:
    assert set(row.reads) | set(row.writes) <= NAMES
    for topic in TOPICS:
        if topic.name in row.reads and topic.readers != ("each daemon",):
            assert row.name in topic.readers, topic.name


@pytest.mark.parametrize(
    "topic", [t for t in TOPICS if t.owner in {row.name for row in PROCESSES}], ids=lambda t: t.name
)
def test_a_topic_is_written_by_its_owner_and_read_by_its_readers(topic: object) -> None:
    row = next(t for t in TOPICS if t is topic)
    by_name = {process.name: process for process in PROCESSES}
    assert row.name in by_name[row.owner].writes
    assert [p.name for p in PROCESSES if row.name in p.writes] == [row.owner], "one owner"
    for reader in set(row.readers) & set(by_name):
        assert row.name in by_name[reader].reads


@pytest.mark.parametrize("row", PROCESSES, ids=lambda row: row.name)
def test_an_entry_point_is_installed_for_every_process(row: Process) -> None:
    scripts = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]["scripts"]
    assert scripts[f"motiondlo-{row.name}"] == f"{row.module}:main"
    assert callable(importlib.import_module(row.module).main)
