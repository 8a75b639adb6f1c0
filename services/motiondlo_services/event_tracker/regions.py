"""``command/set_region`` and ``command/get_config``: what the tracker leaves out, changed and shown while it runs.

Where the cell has a state folder a region set by command is kept there (:mod:`.kept_regions`); else it lasts until the
daemon ends.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any

from motiondlo.events.screening import EventScreening
from motiondlo.events.screening_regions import MOST_REGIONS, covers_nothing, wrong_region
from motiondlo.messages.command import Verb
from motiondlo.tracking.types import EventTracker

VERBS: tuple[Verb, ...] = ("set_region", "get_config")
_NAME_LENGTH = 64


class RefusedError(Exception):
    """A command that cannot be carried out; ``what_to_do`` says how it can."""

    def __init__(self, what: str, what_to_do: str) -> None:
        super().__init__(what)
        self.what_to_do = what_to_do


def screening_of(tracker: EventTracker) -> EventScreening | None:
    """The tracker's screening; None for a tracker that has none."""
    found = getattr(tracker, "screening", None)
    return found if isinstance(found, EventScreening) else None


def set_region(screening: EventScreening | None, args: Mapping[str, Any]) -> dict[str, str]:
    """Add, replace or take away a region; the regions there are now. Raises RefusedError.

    args: ``name``, and ``corners`` in event px: x0, y0, x1, y1 of a rectangle or x, y of each corner of a polygon;
    without corners the region is taken away.
    """
    if screening is None:
        raise RefusedError("This profile's tracker has no regions.", 'Use profile = "default".')
    name, corners = args.get("name"), args.get("corners", ())
    if not isinstance(name, str) or not 0 < len(name) <= _NAME_LENGTH:
        raise RefusedError("name is missing.", f"Give the region a name of up to {_NAME_LENGTH} letters.")
    regions = screening.regions
    if not corners:
        if name not in regions:
            raise RefusedError(f"There is no region {name!r}.", f"Regions: {', '.join(regions) or 'none'}.")
        del regions[name]
    else:
        numbers = isinstance(corners, (tuple, list)) and all(type(value) in (int, float) for value in corners)
        wrong = wrong_region(corners) if numbers else "a list of numbers"
        if not wrong and covers_nothing(corners, screening.geometry):
            wrong = "within the sensor"
        if wrong:
            raise RefusedError(f"corners should be {wrong}.", "Correct corners; they are in event px.")
        if name not in regions and len(regions) >= MOST_REGIONS:
            raise RefusedError(f"There are {MOST_REGIONS} regions already.", "Take one away first.")
        regions[name] = tuple(float(value) for value in corners)
    screening.set_regions(regions)
    return {"regions": json.dumps(screening.regions)}


def running_config(screening: EventScreening | None, config: Mapping[str, Any]) -> dict[str, str]:
    """The section as it is in force, for ``get_config``: JSON texts by option."""
    regions = config.get("regions", {}) if screening is None else screening.regions
    return {name: json.dumps(regions if name == "regions" else value) for name, value in config.items()}
