"""Base of messages whose last field is a large array: events, images. :mod:`motiondlo.messages.wire` has the layout."""

from __future__ import annotations

from typing import Any, ClassVar, Self

import numpy as np

from motiondlo.messages import wire
from motiondlo.messages.arrays import Array, wire_dtype
from motiondlo.messages.header import Message, Stamp
from motiondlo.messages.reject import Expectation


class BulkMessage(Message):
    """A message with one large array, named by ``bulk_key``."""

    bulk_key: ClassVar[str]

    def small_fields(self) -> dict[str, Any]:
        """Wire values of all fields but the header's and the bulk array."""
        raise NotImplementedError

    def to_parts(self, stamp: Stamp) -> tuple[bytes, wire.Tail | None]:
        """The head, and the array's memory."""
        array: Array = np.ascontiguousarray(getattr(self, self.bulk_key))
        fields = {
            "schema": self.schema_major,
            "seq": stamp.seq,
            "cell": stamp.cell,
            "source": stamp.source,
            "t_us": self.t_us,
            "t_sent_ns": stamp.t_sent_ns,
            "valid": self.valid,
            **self.small_fields(),
        }
        head = wire.pack_bulk_head(fields, self.bulk_key, wire_dtype(array.dtype), array.shape, array.nbytes)
        return head, array.reshape(-1).view(np.uint8).data

    @classmethod
    def from_bytes(cls, payload: wire.Payload, expect: Expectation) -> Self:
        """Decode and validate; the array is a read-only view of ``payload``. Raises Rejected."""
        expect.check_size(len(payload))
        return cls.from_map(wire.unpack_bulk(payload), expect)
