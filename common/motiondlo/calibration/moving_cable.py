"""Refine a recording's homography with its moving cables, as both branches see them at the frames' instants."""

from __future__ import annotations

from motiondlo.events.types import SensorGeometry
from motiondlo.frames.types import Segmentation
from motiondlo.fusion.state import FusedDlo
from motiondlo.geometry.curve import distance_to_curve
from motiondlo.geometry.homography import FloatArray, warp_points
from motiondlo.geometry.homography_refinement import CurvePair, HomographyRefinement, Refinement, RefinementParams
from motiondlo.offline.frame_segmenter import FrameSegmenter
from motiondlo.offline.options import TrackOptions
from motiondlo.offline.run_track import prepare
from motiondlo.recording.layout import Recording

_EXPOSURE_MIDDLE_US = 2500
_LEAST_CONFIDENCE = 0.5


def refine_from_cables(recording: Recording, params: RefinementParams | None = None) -> Refinement:
    """Pair every frame's polylines with the event tracker's curves at that instant; propose a homography.

    The recording's own homography is the start. A cable's centre lies a few mm above the board; what lies higher or
    lower than the work plane is shifted by up to about 0.15 mm per mm, which one recording cannot tell from an error
    of the homography. Raises RecordingError or CalibrationError for what the recording lacks.
    """
    given = recording.event_from_rgb()
    size = recording.camera_info.event
    geometry = SensorGeometry() if size is None else SensorGeometry(size.width, size.height)
    refinement = HomographyRefinement(given, (geometry.width_px, geometry.height_px), params)
    segmenter = FrameSegmenter(recording, {})
    waiting = list(recording.frames)
    moved: set[int] = set()
    for state in prepare(recording, TrackOptions()).states():
        moved |= {dlo.id for dlo in state.dlos if dlo.moving}
        # The picture is an average over the exposure: it shows the cable as it was in the middle.
        while waiting and waiting[0].t_us + _EXPOSURE_MIDDLE_US <= state.t_us:
            entry = waiting.pop(0)
            known = [dlo for dlo in state.dlos if dlo.id in moved and dlo.confidence >= _LEAST_CONFIDENCE]
            if not known:
                continue  # a cable that never moved is where the frame branch put it: no second opinion
            back_s = (state.t_us - entry.t_us - _EXPOSURE_MIDDLE_US) / 1e6
            segmentation = segmenter.segment(entry)
            for dlo in known:
                pair = _paired(dlo, segmentation, given, back_s, refinement.match_px)
                if pair is not None:
                    refinement.add(pair)
    return refinement.propose()


def _paired(
    dlo: FusedDlo, segmentation: Segmentation, given: FloatArray, back_s: float, match_px: float
) -> CurvePair | None:
    nodes = dlo.nodes - dlo.velocity_px_s * back_s
    gaps = [
        (float(distance_to_curve(warp_points(i.nodes_rgb, given), nodes).mean()), k)
        for k, i in enumerate(segmentation.instances)
    ]
    if not gaps or min(gaps)[0] > match_px:
        return None
    instance = segmentation.instances[min(gaps)[1]]
    return CurvePair(dlo.id, instance.nodes_rgb, instance.sigma_px, nodes, dlo.sigma_px, dlo.visible)
