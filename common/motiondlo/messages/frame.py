"""An image of the RGB camera at its trigger time."""

from __future__ import annotations

from typing import Annotated, Any, ClassVar, Final, Literal

from pydantic import Field

from motiondlo.messages.arrays import Array, ArraySpec
from motiondlo.messages.bulk import BulkMessage
from motiondlo.messages.header import ShortText, TimeNs

MAX_SIDE_PX: Final = 16384

IMAGE_SPEC: Final = ArraySpec("|u1", (None, None, 3), MAX_SIDE_PX)


class FrameMessage(BulkMessage):
    """One image; ``t_us`` of the header is its trigger's time in the event clock."""

    bulk_key: ClassVar[str] = "image"

    name: Annotated[ShortText, Field(description="File name, or a name that counts up; empty: none.")] = ""
    trigger_id: Annotated[int, Field(ge=-1, description="Number of the trigger since the start; -1: none.")] = -1
    reason: Annotated[Literal["start", "request", "periodic"], Field(description="Why it was taken.")] = "periodic"
    request_id: Annotated[ShortText, Field(description="Of the command that asked for it; empty: none.")] = ""
    channels: Annotated[Literal["bgr", "rgb"], Field(description="Order of the image's last axis.")] = "bgr"
    t_capture_ns: Annotated[TimeNs, Field(description="When the image entered the system.")] = 0
    image: Annotated[Array, IMAGE_SPEC]
    """(H, W, 3) uint8."""

    def small_fields(self) -> dict[str, Any]:
        """All but header and image."""
        return {
            "name": self.name,
            "trigger_id": self.trigger_id,
            "reason": self.reason,
            "request_id": self.request_id,
            "channels": self.channels,
            "t_capture_ns": self.t_capture_ns,
        }
