"""Refine a running homography from curves that both cameras see at one instant: guarded, and reversible.

Only distances along the event curve's normal count: nothing says which point of one curve is which of the other. The
correction is a small homography ``C`` after the given one, with a prior around the identity. A cable higher or lower
than the work plane is shifted in one direction as a whole; each DLO has such a shift as a nuisance, with a prior of its
own, so that one cable cannot pass its height off as an error of the homography.

Legend: ``r`` frame nodes, rgb px; ``x`` the same in event px; ``y`` their nearest places on the event curve; ``n`` its
normals; ``c`` (8,) coefficients of the displacement field of ``C``; ``b`` (2,) shift of one DLO.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt
from pydantic import BaseModel, ConfigDict, Field

from motiondlo.geometry.curve import arc_length, left_normals, point_at, project, resample, tangents
from motiondlo.geometry.homography import checked_homography, warp_points

FloatArray = npt.NDArray[np.float64]

_ROUNDS = 6
_STUDENT_NU = 4.0


class RefinementParams(BaseModel):
    """When and how far a running homography may be refined."""

    model_config = ConfigDict(frozen=True, extra="forbid", strict=True)

    prior_px: float = Field(
        default=0.2,
        ge=0.01,
        le=20.0,
        description="belief in the given homography: error of each of its terms (shift, linear, perspective), px",
    )
    height_px: float = Field(
        default=0.2, ge=0.0, le=20.0, description="shift of a DLO by its height above the work plane (std. dev.), px"
    )
    noise_px: float = Field(default=0.6, ge=0.01, le=5.0, description="least uncertainty of a distance between curves")
    correlation_px: float = Field(
        default=100.0, ge=1.0, le=1000.0, description="length along a DLO over which its distances err alike"
    )
    max_shift_px: float = Field(
        default=3.0, ge=0.1, le=50.0, description="no place of the event image is ever moved further than this"
    )
    match_px: float = Field(default=8.0, ge=0.5, le=100.0, description="nodes further from the event curve are ignored")
    least_pairs: int = Field(default=6, ge=3, le=1000, description="pairs of curves before anything is proposed")
    most_pairs: int = Field(default=60, ge=3, le=10000, description="pairs remembered; the oldest are forgotten")
    least_spread: float = Field(
        default=0.05, ge=0.0, le=1.0, description="least standard deviation of the nodes, in image widths, either way"
    )
    least_gain: float = Field(default=0.1, ge=0.0, le=1.0, description="share by which held-back distances must shrink")


@dataclass(frozen=True)
class CurvePair:
    """One DLO at one instant as both branches see it."""

    dlo: int
    nodes_rgb: FloatArray
    """(M, 2) rgb px."""
    sigma_rgb_px: FloatArray
    """(M,) normal to the curve, event px."""
    nodes_event: FloatArray
    """(K, 2) event px."""
    sigma_event_px: FloatArray
    """(K,) normal to the curve."""
    visible: npt.NDArray[np.uint8]
    """(K,) 1 where events support the node."""


@dataclass(frozen=True)
class Refinement:
    """The outcome of one attempt."""

    event_from_rgb: FloatArray
    """(3, 3): the refined homography when accepted, the one in use otherwise."""
    accepted: bool
    reason: str
    """Why not; empty when accepted."""
    pairs: int
    shift_px: float = 0.0
    """Largest displacement over the event image against the given homography."""
    before_px: float = 0.0
    after_px: float = 0.0
    """Mean absolute distance of the held-back pairs along the normal, before and after."""


@dataclass
class _Rows:
    """Distances of one set of pairs: residuals (N,), design (N, 8 + 2 D), weights' variances (N,), pair (N,)."""

    residual: FloatArray
    design: FloatArray
    variance: FloatArray
    pair: npt.NDArray[np.int64] = field(default_factory=lambda: np.zeros(0, np.int64))


class HomographyRefinement:
    """Collects pairs of curves; proposes a better homography when they agree on one. No I/O, no clock."""

    def __init__(self, given: FloatArray, size_px: tuple[int, int], params: RefinementParams | None = None) -> None:
        """given: (3, 3) event_from_rgb to start from and to stay near; size_px: width and height of the event image."""
        self._given = checked_homography(given)
        self._size = size_px
        self._params = RefinementParams() if params is None else params
        self._pairs: deque[CurvePair] = deque(maxlen=self._params.most_pairs)
        self.event_from_rgb = self._given

    def __len__(self) -> int:
        """Pairs remembered."""
        return len(self._pairs)

    @property
    def match_px(self) -> float:
        """Curves further apart than this are not the same DLO."""
        return self._params.match_px

    def add(self, pair: CurvePair) -> None:
        """Remember a pair; the oldest goes when there are too many."""
        self._pairs.append(pair)

    def propose(self) -> Refinement:
        """Fit the correction to two thirds of the pairs, try it on the others; take it over if it proves itself."""
        pairs, p = list(self._pairs), self._params
        if len(pairs) < p.least_pairs:
            return self._refused("too few pairs", len(pairs))
        if not self._is_spread(pairs):
            return self._refused("the DLOs cover too little of the image", len(pairs))
        kept, held = [q for k, q in enumerate(pairs) if k % 3], pairs[::3]
        trial = self._fitted(kept)
        before, after = self._held_back(held, self.event_from_rgb, trial)
        if len(before) < 2:
            return self._refused("the curves of the two branches do not match", len(pairs))
        gain = before - after
        error = float(gain.std(ddof=1) / np.sqrt(len(gain)))
        mean_before, mean_after = float(before.mean()), float(after.mean())
        if gain.mean() <= max(2.0 * error, p.least_gain * mean_before):
            return self._refused("no significant gain on pairs held back", len(pairs), mean_before, mean_after)
        final = self._fitted(pairs)
        shift = self._largest_shift(final)
        if shift > p.max_shift_px:
            return self._refused(f"would move points by {shift:.1f} px", len(pairs), mean_before, mean_after)
        self.event_from_rgb = final
        return Refinement(final, True, "", len(pairs), shift, mean_before, mean_after)

    def _refused(self, reason: str, pairs: int, before_px: float = 0.0, after_px: float = 0.0) -> Refinement:
        shift = self._largest_shift(self.event_from_rgb)
        return Refinement(self.event_from_rgb, False, reason, pairs, shift, before_px, after_px)

    def _fitted(self, pairs: list[CurvePair]) -> FloatArray:
        """Iterated robust least squares of ``c`` and every DLO's ``b``; nearest places found anew every round."""
        dlos = sorted({pair.dlo for pair in pairs})
        unknowns = 8 + 2 * len(dlos)
        precision = np.zeros(unknowns)
        precision[:8] = self._prior_precision()
        precision[8:] = 1.0 / max(self._params.height_px, 1e-3) ** 2
        state = np.zeros(unknowns)
        current = self._given
        for _ in range(_ROUNDS):
            rows = self._rows(pairs, current, dlos, state[8:])
            # Residuals are about `current`, the prior about the given one: the unknown is the whole state.
            target = rows.residual + rows.design @ np.concatenate([state[:8], np.zeros(unknowns - 8)])
            target += rows.design[:, 8:] @ state[8:]
            weight = np.full(len(target), 1.0) / rows.variance
            r2 = rows.residual**2 / rows.variance
            weight *= (_STUDENT_NU + 1.0) / (_STUDENT_NU + r2)
            normal = rows.design.T @ (rows.design * weight[:, None]) + np.diag(precision)
            state = np.linalg.solve(normal, rows.design.T @ (weight * target))
            current = checked_homography(self._correction(state[:8]) @ self._given)
        return current

    def _rows(self, pairs: list[CurvePair], current: FloatArray, dlos: list[int], shifts: FloatArray) -> _Rows:
        parts = []
        for k, pair in enumerate(pairs):
            column = dlos.index(pair.dlo)
            x, distance, normals, variance = self._distances(pair, current, shifts[2 * column : 2 * column + 2])
            design = np.zeros((len(x), 8 + 2 * len(dlos)))
            design[:, :8] = (normals[:, :, None] * self._field(x)).sum(axis=1)
            design[:, 8 + 2 * column : 10 + 2 * column] = normals
            parts.append(_Rows(-distance, design, variance, np.full(len(x), k)))
        return _Rows(
            np.concatenate([part.residual for part in parts]),
            np.concatenate([part.design for part in parts]),
            np.concatenate([part.variance for part in parts]),
            np.concatenate([part.pair for part in parts]),
        )

    def _distances(
        self, pair: CurvePair, current: FloatArray, shift: FloatArray
    ) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        """Frame nodes in event px (N, 2), their signed distances (N,), normals (N, 2), variances (N,)."""
        p = self._params
        warped = warp_points(pair.nodes_rgb, current)
        count = max(int(arc_length(warped)[-1] / p.correlation_px), 4)
        x = resample(warped, count)
        sigma_frame = np.interp(np.linspace(0, 1, count), np.linspace(0, 1, len(warped)), pair.sigma_rgb_px)
        off, s = project(x + shift, pair.nodes_event)
        knots = arc_length(pair.nodes_event)
        seen = np.interp(s, knots, pair.visible.astype(np.float64)) > 0.99
        inside = (s > 0.02 * knots[-1]) & (s < 0.98 * knots[-1])
        on = (x >= 0).all(axis=1) & (x[:, 0] < self._size[0]) & (x[:, 1] < self._size[1])
        use = seen & inside & on & (off < p.match_px)
        x, s = x[use], s[use]
        normals = left_normals(np.stack([np.interp(s, knots, t) for t in tangents(pair.nodes_event).T], axis=1))
        y = point_at(pair.nodes_event, s)
        distance = ((x + shift - y) * normals).sum(axis=1)
        sigma_event = np.interp(s, knots, pair.sigma_event_px)
        variance = sigma_frame[use] ** 2 + sigma_event**2 + p.noise_px**2
        return x, distance, normals, variance

    def _held_back(
        self, pairs: list[CurvePair], current: FloatArray, trial: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """(P,) mean absolute distances of the pairs that match with both homographies, with one and with the other."""
        means = []
        for pair in pairs:
            distances = [self._distances(pair, h, np.zeros(2))[1] for h in (current, trial)]
            if min(map(len, distances)) >= 3:
                means.append([float(np.abs(d).mean()) for d in distances])
        both = np.array(means).reshape(-1, 2)
        return both[:, 0], both[:, 1]

    def _is_spread(self, pairs: list[CurvePair]) -> bool:
        x = np.concatenate([warp_points(pair.nodes_rgb, self.event_from_rgb) for pair in pairs])
        smallest = float(np.sqrt(max(np.linalg.eigvalsh(np.cov(x.T))[0], 0.0)))
        return smallest >= self._params.least_spread * self._size[0]

    def _field(self, x: FloatArray) -> FloatArray:
        """(N, 2, 8): displacement in px at ``x`` per coefficient: shift, linear, perspective."""
        u, v = self._unit(x).T
        one, zero = np.ones_like(u), np.zeros_like(u)
        return np.stack(
            [
                np.stack([one, u, v, zero, zero, zero, u * u, u * v], axis=1),
                np.stack([zero, zero, zero, one, u, v, u * v, v * v], axis=1),
            ],
            axis=1,
        )

    def _correction(self, c: FloatArray) -> FloatArray:
        """The homography (3, 3) whose displacement near the identity is the field of ``c``."""
        half = self._size[0] / 2.0
        to_unit = np.array(
            [
                [1.0 / half, 0.0, -(self._size[0] - 1) / 2.0 / half],
                [0.0, 1.0 / half, -(self._size[1] - 1) / 2.0 / half],
                [0.0, 0.0, 1.0],
            ]
        )
        g = c / half
        small = np.array([[1.0 + g[1], g[2], g[0]], [g[4], 1.0 + g[5], g[3]], [-g[6], -g[7], 1.0]])
        return np.asarray(np.linalg.inv(to_unit) @ small @ to_unit, dtype=np.float64)

    def _unit(self, x: FloatArray) -> FloatArray:
        return np.asarray((x - (np.array(self._size) - 1) / 2.0) / (self._size[0] / 2.0), dtype=np.float64)

    def _prior_precision(self) -> FloatArray:
        """(8,) the prior error is as large from the shift as from everything that grows away from the middle."""
        return np.full(8, 1.0 / self._params.prior_px**2)

    def _largest_shift(self, h: FloatArray) -> float:
        w, t = self._size[0] - 1.0, self._size[1] - 1.0
        corners = np.array([[0.0, 0.0], [w, 0.0], [w, t], [0.0, t], [w / 2, t / 2]])
        rgb = warp_points(corners, np.asarray(np.linalg.inv(self._given), dtype=np.float64))
        return float(np.hypot(*(warp_points(rgb, h) - corners).T).max())
