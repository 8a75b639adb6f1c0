"""Trackers by profile name: the one place that knows which classes there are."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from pydantic import BaseModel

from motiondlo.config.validation import validated
from motiondlo.errors import ConfigError
from motiondlo.events.types import SensorGeometry
from motiondlo.tracking.types import EventTracker

PROFILES = ("default", "paper")


def tracker_params(profile: str, overrides: Mapping[str, Any]) -> BaseModel:
    """The profile's parameters with ``overrides`` (field name -> value). Raises ConfigError naming what is wrong."""
    if profile == "default":
        from motiondlo.tracking.chain.params import ChainParams

        return validated(ChainParams, overrides, "tracker")
    if profile == "paper":
        from motiondlo.tracking.paper.params import PaperParams

        return validated(PaperParams, overrides, "tracker")
    raise ConfigError(f"profile {profile!r} is not known.", f"Use one of: {', '.join(PROFILES)}.")


def make_tracker(profile: str, overrides: Mapping[str, Any], geometry: SensorGeometry) -> EventTracker:
    """A tracker of the profile for a sensor. Raises ConfigError for an unknown profile or a wrong override."""
    params = tracker_params(profile, overrides)
    if profile == "paper":
        from motiondlo.tracking.paper.params import PaperParams
        from motiondlo.tracking.paper.tracker import PaperTracker

        assert isinstance(params, PaperParams)
        return PaperTracker(params, geometry)
    from motiondlo.tracking.chain.params import ChainParams
    from motiondlo.tracking.chain.tracker import ChainTracker

    assert isinstance(params, ChainParams)
    return ChainTracker(params, geometry)
