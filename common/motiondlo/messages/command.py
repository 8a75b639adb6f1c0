"""Commands to daemons: a request is the payload of a query on ``command/<verb>``, an answer that of its reply."""

from __future__ import annotations

from typing import Annotated, Final, Literal, get_args

from pydantic import Field

from motiondlo.messages.header import Message, Name, ShortText
from motiondlo.messages.health import MAX_ENTRIES, Key, Scalar

Verb = Literal["segment", "reset", "pause", "resume", "set_region", "get_config"]
VERBS: Final[tuple[Verb, ...]] = get_args(Verb)

LongText = Annotated[str, Field(max_length=60_000)]
Value = Scalar | tuple[Scalar, ...] | None


class CommandRequest(Message):
    """What is asked, and of whom."""

    verb: Verb
    target: Annotated[str, Field(max_length=64, description="A daemon; empty: every daemon that serves the verb.")] = ""
    args: Annotated[dict[Key, Value], Field(max_length=MAX_ENTRIES)] = Field(default_factory=dict)


class CommandAnswer(Message):
    """What one daemon made of it: a result, or an error with its remedy."""

    verb: Verb
    daemon: Name
    ok: bool
    error: ShortText = ""
    what_to_do: ShortText = ""
    result: Annotated[dict[Key, Scalar | LongText | tuple[Scalar, ...] | None], Field(max_length=MAX_ENTRIES)] = Field(
        default_factory=dict
    )
