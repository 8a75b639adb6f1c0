"""The header that every message carries, and the base of all message models."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from typing import Annotated, Any, ClassVar, Final, Self, TypeVar

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from motiondlo.messages import wire
from motiondlo.messages.reject import Expectation, Rejected
from motiondlo.rejects import RejectReason

ModelT = TypeVar("ModelT", bound=BaseModel)

SCHEMA_MAJOR: Final = 1
"""Schemas only grow within a major number; a reader refuses a newer one."""
INT_MAX: Final = (1 << 62) - 1
NAME_PATTERN: Final = r"^[A-Za-z0-9][A-Za-z0-9_.-]{0,63}$"
"""Cells and daemons: what is safe within a zenoh key expression."""

TimeUs = Annotated[int, Field(ge=-1, le=INT_MAX, description="Event clock, microseconds; -1: none.")]
TimeNs = Annotated[int, Field(ge=0, le=INT_MAX, description="Host monotonic clock, nanoseconds.")]
Count = Annotated[int, Field(ge=0, le=INT_MAX)]
Name = Annotated[str, Field(pattern=NAME_PATTERN)]
ShortText = Annotated[str, Field(max_length=1000)]


@lru_cache(maxsize=256)
def is_name(text: str) -> bool:
    """Whether ``text`` may name a cell or a daemon."""
    return re.fullmatch(NAME_PATTERN, text) is not None and not text.endswith("\n")


@dataclass(frozen=True, slots=True)
class Stamp:
    """What the publisher writes into the header at the moment of sending."""

    seq: int
    cell: str
    source: str
    t_sent_ns: int


UNSTAMPED = Stamp(0, "unstamped", "unstamped", 0)


class WireModel(BaseModel):
    """Strict and frozen; keys that a reader does not know are ignored."""

    model_config = ConfigDict(
        frozen=True,
        strict=True,
        extra="ignore",
        arbitrary_types_allowed=True,
        allow_inf_nan=False,
        validate_by_name=True,
        validate_by_alias=True,
        serialize_by_alias=True,
        json_schema_serialization_defaults_required=True,
    )


class Message(WireModel):
    """Any message. Producers leave the header's first five fields alone: the publisher writes them when it sends."""

    header_keys: ClassVar[tuple[str, ...]] = ("schema", "seq", "cell", "source", "t_us", "t_sent_ns", "valid")

    schema_major: Annotated[int, Field(alias="schema", ge=1, le=INT_MAX, description="Major number.")] = SCHEMA_MAJOR
    seq: Annotated[int, Field(ge=0, le=INT_MAX, description="Counts up by one per message of a publisher.")] = 0
    cell: Name = "unstamped"
    source: Annotated[str, Field(pattern=NAME_PATTERN, description="The daemon that sends.")] = "unstamped"
    t_us: TimeUs = -1
    t_sent_ns: TimeNs = 0
    valid: Annotated[bool, Field(description="The sender's own inputs were alive and good.")] = True

    @classmethod
    def prepare(cls) -> None:
        """Pay what the first message would cost extra (compiled checks), before real-time work starts."""

    def wire_map(self, stamp: Stamp) -> dict[str, Any]:
        """The msgpack map, header first."""
        fields = self.model_dump(mode="python")
        fields.update(seq=stamp.seq, cell=stamp.cell, t_sent_ns=stamp.t_sent_ns)
        if "source" in self.header_keys:
            fields["source"] = stamp.source
        return fields

    def to_parts(self, stamp: Stamp) -> tuple[bytes, wire.Tail | None]:
        """The payload as its head and, for bulk messages, the contiguous rest (which is never copied here)."""
        return wire.pack(self.wire_map(stamp)), None

    def to_bytes(self, stamp: Stamp = UNSTAMPED) -> bytes:
        """The whole payload."""
        head, tail = self.to_parts(stamp)
        return head if tail is None else b"".join((head, tail))

    @classmethod
    def from_bytes(cls, payload: wire.Payload, expect: Expectation) -> Self:
        """Decode and validate. Raises Rejected with the reason and, where it can be read, the sender."""
        expect.check_size(len(payload))
        return cls.from_map(wire.unpack(payload), expect)

    @classmethod
    def from_map(cls, data: Mapping[Any, Any], expect: Expectation) -> Self:
        """Validate a decoded map. Raises Rejected."""
        sender = check_head(data, cls.header_keys, expect)
        try:
            message = cls.model_validate(data)
        except ValidationError as error:
            raise rejection(error, sender) from None
        expect.check_times(message.t_us, message.t_sent_ns, int(getattr(message, "t_ingest_ns", 0)), sender)
        return message


def check_head(data: object, keys: tuple[str, ...], expect: Expectation) -> str:
    """The sender of a decoded message that has a header, a schema we can read, and our cell. Raises Rejected.

    The schema comes first: what else a newer major number means is not ours to judge.
    """
    if not isinstance(data, dict):
        raise Rejected(RejectReason.SCHEMA_INVALID, "the payload is not a map")
    source = data.get("source")
    sender = source if isinstance(source, str) and is_name(source) else ""
    schema = data.get("schema")
    if type(schema) is not int or schema < 1:
        raise Rejected(RejectReason.SCHEMA_INVALID, f"schema {schema!r} is no version", sender)
    if schema > SCHEMA_MAJOR:
        raise Rejected(RejectReason.SCHEMA_TOO_NEW, f"schema {schema}, this reader knows {SCHEMA_MAJOR}", sender)
    missing = [key for key in keys if key not in data]
    if missing:
        raise Rejected(RejectReason.SCHEMA_INVALID, f"header without {', '.join(missing)}", sender)
    cell = data["cell"]
    if type(cell) is not str or not is_name(cell):
        raise Rejected(RejectReason.SCHEMA_INVALID, "cell is no name", sender)
    if expect.cell is not None and cell != expect.cell:
        raise Rejected(RejectReason.FOREIGN_CELL, f"cell {cell}, this reader serves {expect.cell}", sender)
    return sender


_REASON_OF_ERROR_TYPE: Final = {reason.value: reason for reason in RejectReason} | {
    "finite_number": RejectReason.NOT_FINITE,
    "too_long": RejectReason.TOO_LARGE,
    "string_too_long": RejectReason.TOO_LARGE,
}


def rejection(error: ValidationError, sender: str) -> Rejected:
    """The refusal that a pydantic error amounts to: the first fault, its field and message."""
    fault = error.errors(include_url=False, include_input=False)[0]
    where = ".".join(str(part) for part in fault["loc"])
    reason = _REASON_OF_ERROR_TYPE.get(fault["type"], RejectReason.SCHEMA_INVALID)
    return Rejected(reason, f"{where}: {fault['msg']}", sender)


def trusted(cls: type[ModelT], fields: dict[str, Any]) -> ModelT:
    """A model of values that need no check; fields that are left out take their defaults."""
    return cls.model_construct(None, **fields)
