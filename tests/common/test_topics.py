"""The topic table is complete and consistent."""

from __future__ import annotations

import pytest

from motiondlo.errors import MotionDLOError
from motiondlo.messages.command import VERBS
from motiondlo.topics import ALIVE, COMMAND, HEALTH, STATE, TOPICS, Delivery, all_keys, markdown_table, topic

SUFFIXES = {
    *("events/batch", "events/trigger", "events/clock", "frame", "segmentation", "track", "correction", "state"),
    *("health/{name}", "alive/{name}", "command/{name}"),
}


def test_every_topic_of_the_contract_has_one_row() -> None:
    assert {row.suffix for row in TOPICS} == SUFFIXES
    assert len({row.name for row in TOPICS}) == len(TOPICS)


def test_keys_lie_below_the_cell() -> None:
    assert STATE.key("cell1") == "motiondlo/cell1/state"
    assert HEALTH.key("cell1", "fusion") == "motiondlo/cell1/health/fusion"
    assert HEALTH.key("cell1", "*") == "motiondlo/cell1/health/*"
    assert all_keys("cell1") == "motiondlo/cell1/**"


@pytest.mark.parametrize("cell", ["", "a/b", "*", "cell 1", "$x", "a#b", "?", "cell1\n"])
def test_a_cell_that_would_be_another_key_is_refused(cell: str) -> None:
    with pytest.raises(MotionDLOError, match="cell"):
        STATE.key(cell)


@pytest.mark.parametrize("name", ["", "a/b", "**"])
def test_a_name_that_would_be_another_key_is_refused(name: str) -> None:
    with pytest.raises(MotionDLOError):
        HEALTH.key("cell1", name)


def test_a_topic_without_names_takes_none() -> None:
    with pytest.raises(MotionDLOError):
        STATE.key("cell1", "fusion")


def test_an_unknown_topic_names_those_that_exist() -> None:
    with pytest.raises(MotionDLOError, match="events/batch"):
        topic("events")


def test_all_but_tokens_carry_a_message_and_have_room_for_it() -> None:
    for row in TOPICS:
        assert (row.message is None) == (row is ALIVE)
        assert (row.max_payload_bytes > 0) == (row is not ALIVE)
        assert row.queue > 0


def test_corrections_and_what_leads_to_them_are_never_lost() -> None:
    reliable = {row.name for row in TOPICS if row.delivery is Delivery.RELIABLE}
    assert reliable == {"events/trigger", "segmentation", "correction"}
    assert topic("state").last_value


def test_the_table_for_the_documentation_has_a_line_per_topic() -> None:
    text = markdown_table()
    for row in TOPICS:
        assert f"`{row.suffix.format(name='<verb>' if row is COMMAND else '<daemon>')}`" in text
    for verb in VERBS:
        assert f"`{verb}`" in text
