"""What the kernels of an update take: groups of arrays and numbers under their names.

A kernel that took each array by itself would spend more time on its arguments than on its work.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from motiondlo.frames.types import FloatArray
from motiondlo.tracking.inextensible.params import InextensibleParams

Uint8Array = npt.NDArray[np.uint8]
Float32Array = npt.NDArray[np.float32]
Int64Array = npt.NDArray[np.int64]


class Curve(NamedTuple):
    """The state (legend in :mod:`filter_kernels`) and the curve that it stands for."""

    x: FloatArray
    cov: FloatArray
    kept_x: FloatArray
    """(N,) and (N, N): both as they were before the update."""
    kept_cov: FloatArray
    step: FloatArray
    gain: FloatArray
    basis: FloatArray
    theta: FloatArray
    points: FloatArray
    jacobian: FloatArray
    acceleration: FloatArray
    constants_q: FloatArray
    field: Int64Array
    field_precision: FloatArray
    memory: FloatArray
    ds_px: float
    anchor: int
    stride: int


class Places(NamedTuple):
    """Where the stations are by the state; (m,) unless it says otherwise (see :func:`place_stations`)."""

    s_px: FloatArray
    p: FloatArray
    th: FloatArray
    kappa: FloatArray
    vn: FloatArray
    vt: FloatArray
    omega: FloatArray
    sn: FloatArray
    sv: FloatArray
    h_normal: FloatArray
    h_stretch: FloatArray


class Looks(NamedTuple):
    """What was seen of the stations; (m,) unless it says otherwise."""

    offset: FloatArray
    sigma: FloatArray
    age: FloatArray
    events: Int64Array
    quality: FloatArray
    window: FloatArray
    window_max: FloatArray
    density: FloatArray
    band: FloatArray
    accel: FloatArray
    nis: FloatArray
    active: Uint8Array
    good: Uint8Array
    covered: Uint8Array
    alive: FloatArray
    support: FloatArray
    absent_ms: FloatArray
    seen_ms: FloatArray
    vn_past: FloatArray
    """(4, m)"""
    prior: Float32Array
    """(m, 2, bins), as are the next two."""
    profile: Float32Array
    llr: Float32Array


class RowArrays(NamedTuple):
    """Rows of measurements: (R, N), and (R,) each."""

    h: FloatArray
    z: FloatArray
    w: FloatArray
    robust: Uint8Array


class Numbers(NamedTuple):
    """The parameters that the kernels of an update need, and the sensor's size (see :class:`InextensibleParams`)."""

    width_px: int
    height_px: int
    log_floor: float
    acceleration_px: float
    travel_px: float
    window_min_ms: float
    window_max_ms: float
    band_px: float
    band_sigmas: float
    band_max_px: float
    latency_ms: float
    events_target: int
    events_min: int
    quality_min: float
    ambiguous_velocity: float
    sigma_floor_px: float
    sigma_age: float
    age_share: float
    student_nu: float
    robust_passes: int
    learn_rate: float
    learn_pull: float
    noise_scale: float
    noise_rest_share: float
    noise_speed: float
    noise_memory_ms: float
    velocity_decay_ms: float
    bend_sigma: float
    bend_memory: float
    bend_rate_sigma: float
    rest_sigma: float
    rest_velocity: float


def numbers_of(p: InextensibleParams, width_px: int, height_px: int, floor: float) -> Numbers:
    """The numbers of ``p``; ``floor``: of a profile's bin."""
    same = set(Numbers._fields) & set(InextensibleParams.model_fields) - {"log_floor"}
    return Numbers(
        width_px=width_px,
        height_px=height_px,
        log_floor=floor,
        acceleration_px=p.window_acceleration_px,
        travel_px=p.window_travel_px,
        **{name: getattr(p, name) for name in same},
    )
