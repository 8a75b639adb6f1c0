"""A fault injector between segmentation and fusion: shapes that a segmenter might get wrong, for tests and debugging.

Deterministic: the same frame gives the same wrong shapes.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from enum import StrEnum

import numpy as np
import numpy.typing as npt

from motiondlo.frames.types import EndKind, Instance, Segmentation
from motiondlo.geometry.curve import arc_length, left_normals, resample, tangents
from motiondlo.offline.hybrid_loop import FrameBranch
from motiondlo.recording.layout import FrameEntry

FloatArray = npt.NDArray[np.float64]

_KEPT_SHARE = 0.6
_SWAPPED_AMPLITUDE = 0.12


class WrongShape(StrEnum):
    """What is wrong with every shape."""

    MIRRORED = "mirrored"
    """Bends to the other side of the line between its ends."""
    SHIFTED = "shifted"
    """Beside the DLO."""
    MERGED = "merged"
    """One polyline that runs on into another DLO (or, where there is none, back along itself, beside it)."""
    SWAPPED = "swapped"
    """Another cable's shape, at the DLO's place."""
    SHORTENED = "shortened"
    """Ends too early, with a tip where there is none."""
    EXTRA = "extra"
    """Right, and one DLO more that does not exist."""


SHIFT_MM = 10.0
DEFAULT_PX_PER_MM = 5.0


def with_wrong_shapes(kind: WrongShape, px_per_mm: float | None) -> Callable[[FrameBranch], FrameBranch]:
    """A change of a frame branch: all shapes are wrong but those of its first frame, with which tracking begins."""
    shift_px = SHIFT_MM * (px_per_mm or DEFAULT_PX_PER_MM)

    def changed(branch: FrameBranch) -> FrameBranch:
        first_us = branch.frames[0].t_us

        def segment(entry: FrameEntry) -> Segmentation:
            right = branch.segment(entry)
            return right if entry.t_us == first_us else wrong_segmentation(right, kind, shift_px)

        return replace(branch, segment=segment)

    return changed


def wrong_segmentation(segmentation: Segmentation, kind: WrongShape, shift_px: float) -> Segmentation:
    """``segmentation`` with every shape made wrong; ``shift_px``: how far SHIFTED is off, event px."""
    instances = [i for i in segmentation.instances if i.nodes_event is not None and len(i.nodes_event) >= 2]
    if not instances:
        return segmentation
    curves = [np.asarray(i.nodes_event, dtype=np.float64) for i in instances]
    if kind is WrongShape.EXTRA:
        rng = np.random.default_rng(max(segmentation.t_us, 0))
        offset = rng.uniform(-1.0, 1.0, 2) * 300.0
        ghost = replace(instances[0], nodes_event=_turned(curves[0], rng.uniform(0.0, 2.0 * np.pi)) + offset)
        return replace(segmentation, instances=(*segmentation.instances, ghost))
    change: Callable[[int], Instance] = {
        WrongShape.MIRRORED: lambda k: _with(instances[k], _mirrored(curves[k])),
        WrongShape.SHIFTED: lambda k: _with(instances[k], curves[k] + shift_px * _across(curves[k])),
        WrongShape.MERGED: lambda k: _merged(instances, curves, k),
        WrongShape.SWAPPED: lambda k: _with(instances[k], _swapped(curves, k)),
        WrongShape.SHORTENED: lambda k: _shortened(instances[k], curves[k]),
    }[kind]
    return replace(segmentation, instances=tuple(change(k) for k in range(len(instances))))


def _with(instance: Instance, nodes: FloatArray) -> Instance:
    sigma = np.interp(np.linspace(0, 1, len(nodes)), np.linspace(0, 1, len(instance.sigma_px)), instance.sigma_px)
    return replace(instance, nodes_event=nodes, sigma_px=sigma)


def _across(curve: FloatArray) -> FloatArray:
    chord = curve[-1] - curve[0]
    normal = np.array([-chord[1], chord[0]])
    return np.asarray(normal / max(float(np.hypot(*normal)), 1e-9))


def _mirrored(curve: FloatArray) -> FloatArray:
    normal = _across(curve)
    return np.asarray(curve - 2.0 * ((curve - curve[0]) @ normal)[:, None] * normal)


def _turned(curve: FloatArray, angle_rad: float) -> FloatArray:
    c, s = np.cos(angle_rad), np.sin(angle_rad)
    centre = curve.mean(axis=0)
    return np.asarray((curve - centre) @ np.array([[c, s], [-s, c]]) + centre)


def _merged(instances: Sequence[Instance], curves: Sequence[FloatArray], k: int) -> Instance:
    curve = curves[k]
    if len(curves) > 1:
        other = curves[(k + 1) % len(curves)]
        if np.hypot(*(other[-1] - curve[-1])) < np.hypot(*(other[0] - curve[-1])):
            other = other[::-1]
    else:
        other = (curve + 2.0 * instances[k].diameter_px * left_normals(tangents(curve)))[::-1]
    both = np.vstack([curve, other])
    return replace(_with(instances[k], resample(both, 2 * len(curve))), ends=(instances[k].ends[0], EndKind.TIP))


def _swapped(curves: Sequence[FloatArray], k: int) -> FloatArray:
    curve = curves[k]
    if len(curves) > 1:
        other = curves[(k + 1) % len(curves)]
        return np.asarray(other - other.mean(axis=0) + curve.mean(axis=0))
    length = float(arc_length(curve)[-1])
    u = np.linspace(0.0, 1.0, len(curve))
    wave = _SWAPPED_AMPLITUDE * length * np.sin(2.0 * np.pi * u)
    return np.asarray(curve[0] + u[:, None] * (curve[-1] - curve[0]) + wave[:, None] * _across(curve))


def _shortened(instance: Instance, curve: FloatArray) -> Instance:
    kept = resample(curve, 200)[: round(200 * _KEPT_SHARE)]
    return replace(_with(instance, resample(kept, len(curve))), ends=(instance.ends[0], EndKind.TIP))
