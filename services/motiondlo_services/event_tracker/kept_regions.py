"""Regions that commands have changed, kept in the cell's state folder: a tracker that is started again has them.

Only the changes are kept: what the configuration says goes on to hold for all that no command has touched.
"""

from __future__ import annotations

import json
import os
from collections.abc import Mapping
from pathlib import Path

from motiondlo.events.screening_regions import MOST_REGIONS, wrong_region

Regions = Mapping[str, tuple[float, ...]]

MOST_BYTES = 1 << 20


class KeptRegions:
    """The changes, by name: corners, or None for a region that was taken away."""

    def __init__(self, folder: Path | None, cell: str) -> None:
        """folder: None where nothing is kept. What cannot be read is left where it is, and said in ``problem``."""
        self._path = None if folder is None else folder / cell / "regions.json"
        self._changes: dict[str, tuple[float, ...] | None] = {}
        self.problem = ""
        if self._path is not None:
            self._read(self._path)

    @property
    def kept(self) -> bool:
        """Whether the last change is there after a restart."""
        return self._path is not None and not self.problem

    def applied_to(self, configured: Regions) -> dict[str, tuple[float, ...]]:
        """The configuration's regions with the changes; no more than may be."""
        merged: dict[str, tuple[float, ...] | None] = {**configured, **self._changes}
        return dict([(name, corners) for name, corners in merged.items() if corners is not None][:MOST_REGIONS])

    def change(self, configured: Regions, wanted: Regions) -> None:
        """``wanted`` is what is left out from now on; the difference to ``configured`` is written down."""
        changes: dict[str, tuple[float, ...] | None] = {
            name: corners for name, corners in wanted.items() if configured.get(name) != corners
        }
        self._changes = changes | {name: None for name in configured if name not in wanted}
        if self._path is None:
            return
        # Renamed into place, so that a reader never sees half a file; not synchronised to the disk, which may take
        # longer than the tracker may pause: it is safe against the end of the process, not of the machine's power.
        try:
            self._path.parent.mkdir(parents=True, exist_ok=True)
            half = self._path.with_suffix(".new")
            half.write_text(json.dumps({"regions": self._changes}), encoding="utf-8")
            half.replace(self._path)
            self.problem = ""
        except OSError as error:
            self.problem = f"regions are not kept: {self._path}: {error.strerror}"

    def _read(self, path: Path) -> None:
        try:
            if path.stat().st_size > MOST_BYTES:
                raise ValueError("too large")
            found = json.loads(path.read_text(encoding="utf-8"))["regions"]
            self._changes = {str(name): _corners(value) for name, value in found.items()}
        except FileNotFoundError:
            pass
        except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
            self.problem = f"regions of earlier commands cannot be read: {path}: {error}"


def _corners(value: object) -> tuple[float, ...] | None:
    """Raises ValueError or TypeError for what is no region."""
    if value is None:
        return None
    if not isinstance(value, list):
        raise TypeError("corners are no list")
    corners = tuple(float(part) for part in value)
    wrong = wrong_region(corners)
    if wrong:
        raise ValueError(f"corners should be {wrong}")
    return corners


def state_folder(configured: Path | None) -> Path | None:
    """Where a daemon keeps things: as configured, or where systemd says (``StateDirectory``); None for nowhere."""
    if configured is not None:
        return configured
    given = os.environ.get("STATE_DIRECTORY", "").split(":")[0]
    return Path(given) if given else None
