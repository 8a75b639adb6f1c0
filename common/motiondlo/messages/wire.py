"""msgpack in and out, and the bulk layout: one map whose last value is the last array's data.

A bulk message is an ordinary msgpack map that any msgpack library reads. Its last key is an array whose own last key is
``data``, so the payload is a small head followed by the raw array, and the whole can be written into one buffer of
shared memory without a second copy. A key ``pad`` before it makes the data start at a multiple of 16 bytes.

Considered and rejected: head and data as two zenoh fields (attachment and payload: the attachment is not in shared
memory, and recorders would have to keep both), a private frame around msgpack (unreadable with msgpack alone).
"""

from __future__ import annotations

import struct
from collections.abc import Mapping
from typing import Any, Final

import msgpack

from motiondlo.messages.reject import Rejected
from motiondlo.rejects import RejectReason

Payload = bytes | memoryview
Tail = memoryview
"""Raw bytes of the last array, C-contiguous."""

ALIGNMENT_BYTES: Final = 16
HEAD_BYTES: Final = 4096
"""Heads are looked for within so many bytes; a message with a longer head is read the plain way, with one more copy."""
_BIN32: Final = struct.Struct(">BI")
_BIN_HEADERS: Final = {0xC4: struct.Struct(">B"), 0xC5: struct.Struct(">H"), 0xC6: struct.Struct(">I")}


def pack(fields: Mapping[str, Any]) -> bytes:
    """A msgpack map."""
    packed: bytes = msgpack.packb(fields)
    return packed


def unpack(payload: Payload) -> dict[Any, Any]:
    """The map; arrays of msgpack become tuples. Raises Rejected(NOT_MSGPACK or SCHEMA_INVALID)."""
    try:
        data = msgpack.unpackb(payload, use_list=False)
    except (ValueError, TypeError, msgpack.exceptions.UnpackException) as error:
        raise Rejected(RejectReason.NOT_MSGPACK, str(error) or type(error).__name__) from None
    if not isinstance(data, dict):
        raise Rejected(RejectReason.SCHEMA_INVALID, "the payload is not a map")
    return data


def pack_bulk_head(fields: Mapping[str, Any], key: str, dtype: object, shape: tuple[int, ...], n_bytes: int) -> bytes:
    """Everything before the raw data of the array ``key``, padded so that the data is aligned."""
    packer = msgpack.Packer(autoreset=False)
    packer.pack_map_header(len(fields) + 2)
    for name, value in fields.items():
        packer.pack(name)
        packer.pack(value)
    packer.pack("pad")
    front: bytes = packer.bytes()
    packer.reset()
    packer.pack(key)
    packer.pack_map_header(3)
    for item in ("dtype", dtype, "shape", shape, "data"):
        packer.pack(item)
    back: bytes = packer.bytes()
    n_pad = -(len(front) + 2 + len(back) + _BIN32.size) % ALIGNMENT_BYTES
    return b"".join((front, bytes((0xC4, n_pad)), bytes(n_pad), back, _BIN32.pack(0xC6, n_bytes)))


def unpack_bulk(payload: Payload) -> dict[Any, Any]:
    """As :func:`unpack`, with the last array's data left in place as a memoryview where the layout allows it."""
    view = memoryview(payload)
    head = _read_head(view)
    return unpack(payload) if head is None else head


def _read_head(view: memoryview) -> dict[Any, Any] | None:
    unpacker = msgpack.Unpacker(use_list=False, max_buffer_size=HEAD_BYTES)
    unpacker.feed(view[:HEAD_BYTES])
    try:
        n_keys = unpacker.read_map_header()
        head = {}
        for _ in range(n_keys - 1):
            key = unpacker.unpack()
            head[key] = unpacker.unpack()
        last = unpacker.unpack()
        n_items = unpacker.read_map_header()
        array = {}
        for _ in range(n_items - 1):
            key = unpacker.unpack()
            array[key] = unpacker.unpack()
        if unpacker.unpack() != "data":
            return None
        start = unpacker.tell()
        size_of = _BIN_HEADERS[view[start]]
        (n_bytes,) = size_of.unpack_from(view, start + 1)
    except (ValueError, TypeError, KeyError, IndexError, struct.error, msgpack.exceptions.UnpackException):
        # Not the bulk layout, or damaged: the plain reader decides which, and gives the reason.
        return None
    start += 1 + size_of.size
    if start + n_bytes != len(view):
        return None
    array["data"] = view[start:]
    head[last] = array
    return head
