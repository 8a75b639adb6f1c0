"""``[segmenter]``: backend and parameters of the frame branch."""

from __future__ import annotations

from motiondlo.frames.params import FrameParams


class SegmenterConfig(FrameParams):
    """The segmenter's section: all of it are the frame branch's own parameters."""
