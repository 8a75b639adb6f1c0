"""What ``motiondlo track`` and its relatives can be told."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from pathlib import Path
from typing import Any

from motiondlo.config.validation import parse_assignment
from motiondlo.errors import ConfigError

SECTIONS = ("tracker", "fusion", "frames")


class TrackMode(StrEnum):
    """Which branches take part."""

    HYBRID = "hybrid"
    EVENT = "event"
    """No frames: the paper's tracker, which finds its DLO in the events; the default one begins with a frame."""
    FRAME = "frame"
    """Shapes from frames only, held in between."""


@dataclass(frozen=True)
class TrackOptions:
    """How a recording is tracked."""

    profile: str = "default"
    mode: TrackMode = TrackMode.HYBRID
    update_us: int = 2000
    """Batch period: one estimate of every DLO per batch."""
    segmenter_latency_ms: float = 1000.0
    """How long after its request a segmentation is used, event time."""
    rgb_lens: Path | None = None
    """Lens file of the RGB camera; the homography then relates undistorted pixels."""
    event_lens: Path | None = None
    """The same of the event camera."""
    timed: bool = False
    """The tracker tells the host's time per stage with every update."""
    tracker: Mapping[str, Any] = field(default_factory=dict)
    """Overrides of the tracker's parameters."""
    fusion: Mapping[str, Any] = field(default_factory=dict)
    """Overrides of fusion's parameters."""
    frames: Mapping[str, Any] = field(default_factory=dict)
    """Overrides of the frame branch's parameters; nested sections as nested mappings."""


def overrides_from(assignments: Iterable[str]) -> dict[str, dict[str, Any]]:
    """``section.field=value`` lines by section; further dots nest. Raises ConfigError naming the line that is wrong."""
    sections: dict[str, dict[str, Any]] = {name: {} for name in SECTIONS}
    for text in assignments:
        key, value = parse_assignment(text)
        section, *path = key.split(".")
        if section not in sections or not path or not all(path):
            raise ConfigError(
                f"--set {text!r}: {key} names no parameter.",
                f"It begins with one of: {', '.join(SECTIONS)}, and a dot.",
            )
        target = sections[section]
        for part in path[:-1]:
            target = target.setdefault(part, {})
            if not isinstance(target, dict):
                raise ConfigError(f"--set {text!r}: {part} was set to a value before.", "Set either, not both.")
        target[path[-1]] = value
    return sections
