"""Arrays on the wire, ``{"dtype": "<f4", "shape": [..], "data": bytes}``, and the pydantic annotation for them."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import numpy.typing as npt
from pydantic import GetCoreSchemaHandler, GetJsonSchemaHandler
from pydantic.json_schema import JsonSchemaValue
from pydantic_core import CoreSchema, PydanticCustomError, core_schema

from motiondlo.messages.reject import Rejected
from motiondlo.rejects import RejectReason

Array = npt.NDArray[Any]
WireDtype = str | tuple[tuple[str, str], ...]
"""A numpy dtype string, or the fields (name, dtype string) of a structured dtype; unnamed fields are padding."""

MAX_NODES: Final = 1024
"""Nodes of one DLO."""
MAX_DLOS: Final = 64


def wire_dtype(dtype: np.dtype[Any]) -> WireDtype:
    """The dtype as it stands on the wire: "<f4", or the field list of a structured dtype."""
    if dtype.fields is None:
        return dtype.str
    return tuple((str(name), str(kind)) for name, kind, *_ in dtype.descr)


@dataclass(frozen=True)
class ArraySpec:
    """What an array field must be. Used as ``Annotated[Array, ArraySpec(...)]`` and by the hand-written readers."""

    dtype: npt.DTypeLike
    shape: tuple[int | None, ...]
    """Length per axis; None: any length up to ``max_length``."""
    max_length: int = MAX_NODES

    def __post_init__(self) -> None:
        dtype = np.dtype(self.dtype)
        object.__setattr__(self, "_dtype", dtype)
        object.__setattr__(self, "_wire_dtype", wire_dtype(dtype))
        object.__setattr__(self, "_finite", dtype.kind == "f")

    @property
    def numpy_dtype(self) -> np.dtype[Any]:
        """The dtype that arrays have in memory and on the wire."""
        dtype: np.dtype[Any] = self.__dict__["_dtype"]
        return dtype

    def read(self, value: object) -> Array:
        """The array of a wire map or of an ndarray (cast to the dtype); from bytes it is a read-only view.

        Raises Rejected: SCHEMA_INVALID (no array, another dtype), WRONG_SHAPE, TOO_LARGE, NOT_FINITE.
        """
        if isinstance(value, dict):
            return self._read_map(value)
        if not isinstance(value, np.ndarray):
            raise Rejected(RejectReason.SCHEMA_INVALID, f"an array is expected, not {type(value).__name__}")
        self.check_shape(value.shape)
        if value.dtype != self.numpy_dtype and not np.can_cast(value.dtype, self.numpy_dtype, "same_kind"):
            raise Rejected(RejectReason.SCHEMA_INVALID, f"dtype {value.dtype} does not become {self.numpy_dtype}")
        return self._check_finite(np.ascontiguousarray(value, self.numpy_dtype))

    def _read_map(self, value: dict[Any, Any]) -> Array:
        own = self.__dict__
        shape, data = value.get("shape"), value.get("data")
        if value.get("dtype") != own["_wire_dtype"]:
            raise Rejected(RejectReason.SCHEMA_INVALID, f"dtype {value.get('dtype')!r}, not {own['_wire_dtype']!r}")
        if type(shape) is not tuple or type(data) not in (bytes, memoryview):
            raise Rejected(RejectReason.SCHEMA_INVALID, "an array needs dtype, shape and data")
        self.check_shape(shape)
        assert isinstance(data, bytes | memoryview)
        if len(data) != math.prod(shape) * own["_dtype"].itemsize:
            raise Rejected(RejectReason.WRONG_SHAPE, f"{len(data)} bytes do not hold {shape} of {own['_wire_dtype']}")
        array = np.frombuffer(data, own["_dtype"])
        return self._check_finite(array if len(shape) == 1 else array.reshape(shape))

    def check_shape(self, shape: tuple[object, ...]) -> None:
        """Raises Rejected: WRONG_SHAPE, TOO_LARGE."""
        if len(shape) != len(self.shape):
            raise Rejected(RejectReason.WRONG_SHAPE, f"shape {shape}, expected {self.shape}")
        for length, wanted in zip(shape, self.shape, strict=True):
            if type(length) is not int or length < 0 or (wanted is not None and length != wanted):
                raise Rejected(RejectReason.WRONG_SHAPE, f"shape {shape}, expected {self.shape}")
            if wanted is None and length > self.max_length:
                raise Rejected(RejectReason.TOO_LARGE, f"shape {shape}, at most {self.max_length} along an axis")

    def _check_finite(self, array: Array) -> Array:
        if self.__dict__["_finite"] and not np.isfinite(array).all():
            raise Rejected(RejectReason.NOT_FINITE, "an array holds NaN or infinity")
        return array

    def __get_pydantic_core_schema__(self, source: object, handler: GetCoreSchemaHandler) -> CoreSchema:
        """Read either form; write the wire map."""

        def read(value: object) -> Array:
            try:
                return self.read(value)
            except Rejected as rejected:
                raise PydanticCustomError(rejected.reason.value, "{detail}", {"detail": rejected.detail}) from None

        write: Callable[[Array], dict[str, object]] = self.pack
        return core_schema.no_info_plain_validator_function(
            read, serialization=core_schema.plain_serializer_function_ser_schema(write)
        )

    def pack(self, array: Array) -> dict[str, object]:
        """The wire map."""
        return {"dtype": self.__dict__["_wire_dtype"], "shape": array.shape, "data": array.tobytes()}

    def __get_pydantic_json_schema__(self, schema: CoreSchema, handler: GetJsonSchemaHandler) -> JsonSchemaValue:
        """The wire map in JSON Schema; msgpack bin data is base64 text there."""
        axes = [
            {"type": "integer", "minimum": 0, "maximum": self.max_length} if n is None else {"const": n}
            for n in self.shape
        ]
        dtype = self.__dict__["_wire_dtype"]
        return {
            "type": "object",
            "description": "Little-endian, C-contiguous array.",
            "properties": {
                "dtype": {"const": dtype if isinstance(dtype, str) else [list(pair) for pair in dtype]},
                "shape": {"type": "array", "prefixItems": axes, "minItems": len(axes), "maxItems": len(axes)},
                "data": {
                    "type": "string",
                    "contentEncoding": "base64",
                    "description": "msgpack bin; as base64 where the message is shown as JSON text.",
                },
            },
            "required": ["dtype", "shape", "data"],
        }
