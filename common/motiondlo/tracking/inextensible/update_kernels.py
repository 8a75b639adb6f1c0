"""The two halves of an update: predict and look, then take in what was seen. Each is one call from Python."""

from __future__ import annotations

import numba
import numpy as np

from motiondlo.tracking.inextensible.curve_kernels import ANGLE_FLOOR, acceleration_covariance, place_curve
from motiondlo.tracking.inextensible.filter_kernels import STRETCH, keep_bend, place_stations, predict, solve
from motiondlo.tracking.inextensible.observe_kernels import learn_profiles, observe_stations
from motiondlo.tracking.inextensible.row_kernels import remember_bend, station_rows, update_support
from motiondlo.tracking.inextensible.step_kernels import fast_speed, fit_summary, leave_out, prepare_stations

LARGEST_SIGMA_PX = 80.0
LOST_DECAY_MS = 20.0
LEARN_TURNS = 4
LEARN_VELOCITY = 0.3


@numba.njit(cache=True, nogil=True)
def locate(c, s, n):  # type: ignore[no-untyped-def]
    """Evaluate the curve at its state, and what the stations need of it. n: length of a pose."""
    place_curve(
        c.x[:n], 1.0 + c.x[2 * n + STRETCH], c.basis, c.ds_px, c.anchor, c.stride, c.theta, c.points, c.jacobian
    )
    place_stations(
        c.x, c.cov, n, c.points, c.theta, c.jacobian, c.stride, c.ds_px, s.p, s.th, s.kappa, s.vn, s.vt, s.omega,
        s.h_normal, s.h_stretch, s.sn, s.sv,
    )  # fmt: skip


@numba.njit(cache=True, nogil=True)
def advance(c, s, n, dt_ms, noise, velocity_decay_ms):  # type: ignore[no-untyped-def]
    """Predict by ``dt_ms`` with an acceleration noise of ``noise`` px^2/ms^3."""
    decay = np.exp(-dt_ms / velocity_decay_ms)
    if s.sn.max() > LARGEST_SIGMA_PX:
        # Out of sight for long: it is lost there already, more noise would only spoil the numbers.
        noise = 0.0
        decay = np.exp(-dt_ms / LOST_DECAY_MS)
    predict(c.x, c.cov, n, dt_ms, decay, c.acceleration, noise, c.constants_q)
    locate(c, s, n)


@numba.njit(cache=True, nogil=True)
def look(  # type: ignore[no-untyped-def]
    c, s, o, rows, p, n, rings, heads, columns, background, region, rivals, block, t_us, dt_ms, bridged_ms,
    recent_speed, noise_factor, lo_px, hi_px, past, forget,
):  # fmt: skip
    """Predict to ``t_us``, look at every station, and write the rows of what was seen.

    background: (tiles,) float32 events/px/ms; region: (H, W) uint8, not 0 where nothing is to be seen, or (0, 0);
    rivals, block: the stations of all DLOs, and which of them are these. bridged_ms: for how long it is predicted;
    (lo_px, hi_px): material extent that is looked at; forget: what is kept of before is the prediction. Returns (rows,
    stations seen, stations that could be seen, speed before the prediction, recent speed).
    """
    speed = fast_speed(s.vn, s.vt)
    recent_speed = max(speed, recent_speed * np.exp(-dt_ms / p.noise_memory_ms))
    share = max(p.noise_rest_share, min(recent_speed / p.noise_speed, 1.5))
    c.kept_x[:] = c.x
    c.kept_cov[:, :] = c.cov
    advance(c, s, n, bridged_ms, p.noise_scale * share * noise_factor, p.velocity_decay_ms)
    if forget:
        c.kept_x[:] = c.x
        c.kept_cov[:, :] = c.cov
    prepare_stations(
        dt_ms, s.p, s.s_px, s.vn, o.vn_past, past, s.sn, lo_px, hi_px, p.width_px, p.height_px, p.acceleration_px,
        p.travel_px, p.window_min_ms, p.window_max_ms, p.band_px, p.band_sigmas, p.band_max_px, o.active, o.accel,
        o.window_max, o.band,
    )  # fmt: skip
    if region.shape[0] > 0:
        leave_out(s.p, region, o.active)
    observe_stations(
        rings, heads, columns, background, t_us, s.p, s.th, s.kappa, s.vn, s.vt, s.omega, s.sn, s.sv, o.window_max,
        o.band, o.active, rivals, block, o.profile, o.llr, 0.0, p.log_floor, 0.5 * c.stride * c.ds_px, p.latency_ms,
        p.window_min_ms, p.events_target, p.events_min, p.ambiguous_velocity, o.offset, o.sigma, o.age, o.events,
        o.quality, o.window, o.density,
    )  # fmt: skip
    count, seen, could = station_rows(
        n, dt_ms, s.h_normal, s.h_stretch, s.vn, s.sn, o.offset, o.sigma, o.age, o.events, o.quality, o.window,
        o.active, o.alive, p.sigma_floor_px, p.sigma_age, p.age_share, p.quality_min, p.events_min, p.rest_sigma,
        p.rest_velocity, rows.h, rows.z, rows.w, rows.robust, o.good, o.covered, o.nis,
    )  # fmt: skip
    return count, seen, could, speed, recent_speed


@numba.njit(cache=True, nogil=True)
def take_in(c, s, o, rows, p, n, count, dt_ms, refresh):  # type: ignore[no-untyped-def]
    """Update from ``count`` rows and the remembered bend.

    refresh: evaluate the acceleration's covariance anew. Returns (the numbers held, stations seen, their median squared
    innovation, root mean square offset px); where the numbers failed, state and covariance are spoilt.
    """
    c.step[:] = 0.0
    keep_bend(n, dt_ms, c.x, c.memory, p.bend_sigma, p.bend_rate_sigma, c.cov, c.step, c.gain)
    if not solve(c.cov, c.step, rows.h, rows.z, rows.w, count, p.student_nu, p.robust_passes, rows.robust):
        return False, 0, 0.0, 0.0
    for i in range(c.x.shape[0]):
        c.x[i] += c.step[i]
    locate(c, s, n)
    if refresh:
        acceleration_covariance(c.jacobian, c.field, c.field_precision, ANGLE_FLOOR, c.acceleration)
    remember_bend(n, c.x, p.bend_memory * dt_ms, o.alive, c.memory)
    seen, median, fit_px = fit_summary(o.good, o.nis, o.offset)
    return True, seen, median, fit_px


@numba.njit(cache=True, nogil=True)
def remember(c, s, o, p, rings, heads, columns, background, rivals, block, t_us, dt_ms, learn, turn, past):  # type: ignore[no-untyped-def]
    """Learn the profiles, if ``learn`` says so, and follow what is known of every station.

    Returns how many rates are remembered.
    """
    if learn:
        learn_profiles(
            rings, heads, columns, background, t_us, s.p, s.th, s.kappa, s.vn, s.vt, s.omega, s.sn, o.window, o.good,
            rivals, block, o.density, turn % LEARN_TURNS, LEARN_TURNS, LEARN_VELOCITY, 0.5 * c.stride * c.ds_px,
            p.latency_ms, p.learn_rate, p.learn_pull, p.log_floor, o.prior, o.profile, o.llr,
        )  # fmt: skip
    return update_support(
        dt_ms, o.active, o.good, o.covered, o.events, s.vn, p.events_min, o.alive, o.support, o.absent_ms, o.seen_ms,
        o.vn_past, past,
    )  # fmt: skip
