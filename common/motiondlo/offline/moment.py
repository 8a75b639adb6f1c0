"""One moment of a recording as a picture: events, truth and estimates."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import numpy.typing as npt

from motiondlo.drawing.event_image import event_image
from motiondlo.drawing.overlay import DrawnDlo, overlay
from motiondlo.errors import RecordingError
from motiondlo.events.reader import open_events
from motiondlo.events.types import EventArray, SensorGeometry, empty_events
from motiondlo.offline.evaluation import Verdict
from motiondlo.offline.ground_truth import GroundTruth
from motiondlo.offline.matching import FRESH_US, latest_rows
from motiondlo.offline.tracks import Tracks

Image = npt.NDArray[np.uint8]

_SHOWN_US = 5000


def worst_moment(verdict: Verdict) -> int | None:
    """Event time at which the judged estimate was farthest off (point-to-curve, or else coverage); None without any."""
    errors = verdict.errors
    if errors is None:
        return None
    worst = np.where(np.isfinite(errors.ptc_mm), errors.ptc_mm, errors.cov_mm)
    worst = np.where(errors.judged & np.isfinite(worst), worst, -1.0)
    return int(errors.times_us[int(worst.argmax())]) if len(worst) and worst.max() >= 0.0 else None


def picture_at(recording: Path, tracks: Tracks, truth: GroundTruth, t_us: int) -> Image:
    """(H, W, 3) uint8 BGR: the events of the 5 ms before ``t_us``, true centrelines dashed, the newest estimates."""
    image = event_image(_events_before(recording, t_us), SensorGeometry(truth.width_px, truth.height_px))
    drawn = []
    for track_id in tracks.known_ids():
        rows = tracks.estimates_of(track_id)
        k = int(latest_rows(tracks.times_us[rows], np.array([t_us]))[0])
        if k >= 0 and t_us - tracks.times_us[rows[k]] <= FRESH_US:
            row = rows[k]
            drawn.append(DrawnDlo(track_id, tracks.nodes[row].astype(float), tracks.sigma_px[row].astype(float)))
    curves = [truth.nodes_at(dlo, np.array([t_us]))[0] for dlo in range(truth.count)]
    return overlay(image, drawn, truth=curves, caption=f"t = {t_us / 1e6:.3f} s   dashed: truth")


def _events_before(recording: Path, t_us: int) -> EventArray:
    """Events of the last 5 ms; none where the recording has no events that can be read."""
    shown = []
    try:
        for batch in open_events(recording / "events.raw").batches(_SHOWN_US, start_us=max(t_us - _SHOWN_US, 0)):
            times_us = batch.events["t"]
            shown.append(batch.events[(times_us > t_us - _SHOWN_US) & (times_us <= t_us)])
            if batch.t1_us > t_us:
                break
    except RecordingError:
        pass
    return np.concatenate(shown) if shown else empty_events()
