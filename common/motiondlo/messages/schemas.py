"""JSON Schemas of all messages, for people who do not use Python. ``python -m motiondlo.messages.schemas FOLDER``."""

from __future__ import annotations

import base64
import json
import sys
from pathlib import Path
from typing import Any, Final

from motiondlo.messages.command import CommandAnswer, CommandRequest
from motiondlo.messages.correction import CorrectionMessage
from motiondlo.messages.events import ClockMessage, EventBatchMessage, TriggerMessage
from motiondlo.messages.frame import FrameMessage
from motiondlo.messages.header import Message
from motiondlo.messages.health import HealthMessage
from motiondlo.messages.segmentation import SegmentationMessage
from motiondlo.messages.state import StateMessage
from motiondlo.messages.track import TrackMessage

MODELS: Final[dict[str, type[Message]]] = {
    "events_batch": EventBatchMessage,
    "events_trigger": TriggerMessage,
    "events_clock": ClockMessage,
    "frame": FrameMessage,
    "segmentation": SegmentationMessage,
    "track": TrackMessage,
    "correction": CorrectionMessage,
    "state": StateMessage,
    "health": HealthMessage,
    "command_request": CommandRequest,
    "command_answer": CommandAnswer,
}
DRAFT: Final = "https://json-schema.org/draft/2020-12/schema"


def json_schema(name: str) -> dict[str, Any]:
    """The schema of the message ``name`` (a key of MODELS) on the wire, with all keys that senders write."""
    schema = MODELS[name].model_json_schema(by_alias=True, mode="serialization")
    return {"$schema": DRAFT, **schema}


def export(folder: Path) -> list[Path]:
    """Write ``<name>.json`` for every message into ``folder``; gives the files."""
    folder.mkdir(parents=True, exist_ok=True)
    written = []
    for name in MODELS:
        path = folder / f"{name}.json"
        path.write_text(json.dumps(json_schema(name), indent=2, sort_keys=True) + "\n", encoding="utf-8")
        written.append(path)
    return written


def as_json(value: object) -> Any:
    """A decoded message as JSON text can hold it: bytes become base64, tuples lists."""
    if isinstance(value, dict):
        return {str(key): as_json(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [as_json(item) for item in value]
    if isinstance(value, bytes | memoryview):
        return base64.b64encode(value).decode("ascii")
    return value


if __name__ == "__main__":
    export(Path(sys.argv[1]))
