"""Cut a span out of a recording, with everything that belongs to it: ``python -m motiondlo.recording.cropping``."""

from __future__ import annotations

import argparse
import json
import shutil
from pathlib import Path

import numpy as np

from motiondlo.errors import RecordingError
from motiondlo.events.writer import crop_recording_events
from motiondlo.recording.layout import open_recording

_COPIED = ("camera_info.json", "background.jpg", "homography")
_PER_TIME = ("nodes", "visibility", "moving", "speed_mm_s", "height_mm")
"""Fields of the ground truth with a time axis behind the one of the DLOs."""


def crop_recording(src: Path, dst: Path, t0_us: int, t1_us: int) -> int:
    """Write the span ``t0_us <= t < t1_us`` of ``src`` to the new folder ``dst``; its time starts at 0.

    Returns the number of events. Raises RecordingError when ``src`` is no recording or ``dst`` exists already.
    """
    recording = open_recording(src)
    try:
        (dst / "frames").mkdir(parents=True)
    except FileExistsError as error:
        raise RecordingError(f"{dst}: exists already.", "Choose a new folder.") from error
    count = crop_recording_events(recording.events_path, dst / "events.raw", t0_us, t1_us)
    manifest = {}
    for entry in recording.frames:
        if t0_us <= entry.t_us < t1_us:
            shutil.copyfile(entry.path, dst / "frames" / entry.name)
            manifest[entry.name] = entry.t_us - t0_us
    (dst / "manifest.json").write_text(json.dumps(manifest, indent=1) + "\n", encoding="utf-8")
    for name in _COPIED:
        if (src / name).is_dir():
            shutil.copytree(src / name, dst / name)
        elif (src / name).is_file():
            shutil.copyfile(src / name, dst / name)
    if recording.ground_truth_path.is_file():
        _crop_ground_truth(recording.ground_truth_path, dst / "ground_truth.npz", t0_us, t1_us)
    return count


def _crop_ground_truth(src: Path, dst: Path, t0_us: int, t1_us: int) -> None:
    with np.load(src, allow_pickle=False) as archive:
        truth = dict(archive)
    kept = (truth["times_us"] >= t0_us) & (truth["times_us"] < t1_us)
    truth["times_us"] = truth["times_us"][kept] - t0_us
    for name in _PER_TIME:
        if name in truth:
            truth[name] = truth[name][:, kept]
    if "boxes_px" in truth:
        truth["boxes_px"] = truth["boxes_px"][kept]
    np.savez_compressed(dst, allow_pickle=False, **truth)


def main() -> None:
    """Command line of this module."""
    parser = argparse.ArgumentParser(description="Cut a span out of a recording.")
    parser.add_argument("src", type=Path)
    parser.add_argument("dst", type=Path)
    parser.add_argument("t0_us", type=int)
    parser.add_argument("t1_us", type=int)
    args = parser.parse_args()
    crop_recording(args.src, args.dst, args.t0_us, args.t1_us)


if __name__ == "__main__":
    main()
