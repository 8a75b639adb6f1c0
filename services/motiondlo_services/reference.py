"""The reference configuration: every option there is, with its default and what it means.

``python -m motiondlo_services.reference > config/reference.toml`` writes it anew; a test says when that is due.
"""

from __future__ import annotations

import json
import sys
import textwrap
from collections.abc import Iterator

from pydantic import BaseModel

from motiondlo.tracking.factory import PROFILES, tracker_params
from motiondlo_services.cell_config import SECTIONS
from motiondlo_services.processes import PROCESSES
from motiondlo_services.runtime.bus_section import default_endpoints

_HEAD = """\
# Every option of a cell, with its default. A cell's own file needs only what differs: see replay.toml.
# Relative paths start at the folder of the configuration file. Unknown names and values out of bounds are refused;
# `motiondlo doctor --config FILE` says what is wrong, and what to do about it.
"""
_WIDTH = 118


def reference_configuration() -> str:
    """The whole file."""
    lines = [_HEAD]
    owners = {row.section: row.name for row in PROCESSES}
    for name, model in SECTIONS.items():
        lines += _section(model, name, f"read by {owners[name]}" if name in owners else "read by every daemon")
        if name == "bus":
            lines += ["", "# [bus.endpoints]", "# own endpoints instead of the default ports"]
            lines += [f"# {daemon} = {json.dumps(endpoint)}" for daemon, endpoint in default_endpoints().items()]
        if name == "event_tracker":
            lines += ["", "# [event_tracker.regions]"]
            lines += _comment(model.model_fields["regions"].description or "")
            lines += ["# belt = [0, 500, 1280, 620]", "# display = [900, 40, 1200, 60, 1190, 200, 910, 190]"]
            for profile in PROFILES:
                lines += ["", f"# [event_tracker.parameters] with profile = {json.dumps(profile)}"]
                lines += [f"# {line}" if not line.startswith("#") else line for line in _profile(profile)]
    return "\n".join(lines) + "\n"


def _section(model: type[BaseModel], name: str, remark: str = "") -> Iterator[str]:
    yield ""
    yield f"[{name}]" + (f"  # {remark}" if remark else "")
    nested = []
    for field, info in model.model_fields.items():
        if isinstance(info.annotation, type) and issubclass(info.annotation, BaseModel):
            nested.append((field, info.annotation))
            continue
        default = info.get_default(call_default_factory=True)
        if isinstance(default, dict):
            continue
        yield from _comment(info.description or "")
        yield f"{field} = {json.dumps(default)}"
    for field, inner in nested:
        yield from _section(inner, f"{name}.{field}")


def _profile(profile: str) -> Iterator[str]:
    params = tracker_params(profile, {})
    for field, info in type(params).model_fields.items():
        value = getattr(params, field)
        if isinstance(value, bool | int | float | str):
            yield from _comment(info.description or "")
            yield f"{field} = {json.dumps(value)}"


def _comment(text: str) -> Iterator[str]:
    for line in textwrap.wrap(text, _WIDTH):
        yield f"# {line}"


if __name__ == "__main__":
    sys.stdout.write(reference_configuration())
