"""``[fusion]``: the fusion core's parameters."""

from __future__ import annotations

from motiondlo.fusion.params import FusionParams


class FusionConfig(FusionParams):
    """The fusion daemon's section: all of it are the core's own parameters."""
