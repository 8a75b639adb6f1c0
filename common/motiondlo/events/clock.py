"""Event clock to host clock: offset, drift, uncertainty, steps.

Data arrive after a delay that is never negative and now and then nearly the smallest possible. So in the plane of event
time against arrival time the truth is a line below all points, close to the lowest ones: the lower convex hull's edge
over the middle of a sliding window is the line that minimises the mean distance (a linear programme with two unknowns).
The delay that is always there stays in the offset; it cannot be seen from one side.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from itertools import pairwise

from pydantic import BaseModel, ConfigDict, Field


class ClockParams(BaseModel):
    """How the mapping from the event clock to the host clock is estimated."""

    model_config = ConfigDict(frozen=True, strict=True, extra="forbid")

    bucket_us: int = Field(default=100_000, ge=1000, le=10_000_000, description="one lowest point is kept per bucket")
    buckets: int = Field(default=100, ge=4, le=10_000, description="length of the sliding window in buckets")
    drift_span_us: int = Field(default=2_000_000, ge=1000, description="shorter spans cannot tell drift from jitter")
    max_drift_ppm: float = Field(default=500.0, gt=0, le=100_000, description="a crystal is better than this")
    early_step_ns: int = Field(default=5_000_000, ge=1000, description="data earlier by this much: the clock stepped")
    late_step_ns: int = Field(default=20_000_000, ge=1000, description="data later by this much for long: it stepped")
    late_buckets: int = Field(default=10, ge=1, le=1000, description="how long, in buckets")


@dataclass
class _Lowest:
    """The pair of a bucket with the smallest ``host_ns - t_us * 1000``."""

    bucket: int
    t_us: int
    skew_ns: int


class ClockEstimator:
    """Mapping between event-camera microseconds and host ``monotonic_ns``; reads no clock itself."""

    def __init__(self, params: ClockParams | None = None) -> None:
        self.params = params or ClockParams()
        self.steps = 0
        """Steps of either clock so far, restarts of the camera included."""
        self._reset()

    def _reset(self) -> None:
        self._lowest: deque[_Lowest] = deque(maxlen=self.params.buckets)
        self._reference_us = 0
        self._offset_ns = 0
        self._drift = 0.0
        self._spread_ns = 0.0
        self._newest_us = 0
        self._late_since: int | None = None

    @property
    def ready(self) -> bool:
        """Whether there is a mapping at all."""
        return bool(self._lowest)

    @property
    def offset_ns(self) -> int:
        """Host time minus event time, ns, at the newest pair."""
        return self.host_ns(self._newest_us) - self._newest_us * 1000 if self.ready else 0

    @property
    def drift_ppm(self) -> float:
        """How much faster the host clock runs than the event clock, parts per million."""
        return self._drift * 1e6

    @property
    def uncertainty_us(self) -> float:
        """How far the lowest arrivals scatter above the line, us; the constant part of the delay is not in it."""
        return self._spread_ns / 1000.0

    def update(self, t_us: int, host_ns: int) -> bool:
        """Take the newest event time of a piece of data, and the host time at which it arrived.

        Returns True when the pair shows that a clock stepped: the mapping then starts anew from this pair.
        """
        if self.ready and self._is_step(t_us, host_ns):
            self.steps += 1
            self._reset()
            self._add(t_us, host_ns)
            return True
        self._add(t_us, host_ns)
        return False

    def host_ns(self, t_us: int) -> int:
        """Host time at which data of event time ``t_us`` arrive at the earliest. Raises RuntimeError if not ready."""
        if not self.ready:
            raise RuntimeError("the clock estimator has seen no data yet")
        return t_us * 1000 + self._offset_ns + round(self._drift * (t_us - self._reference_us) * 1000)

    def event_us(self, host_ns: int) -> int:
        """The event time that arrives at ``host_ns``, inverse of :meth:`host_ns`. Raises RuntimeError if not ready."""
        if not self.ready:
            raise RuntimeError("the clock estimator has seen no data yet")
        since_ns = host_ns - self._offset_ns - self._reference_us * 1000
        return self._reference_us + round(since_ns / (1.0 + self._drift) / 1000)

    def as_dict(self) -> dict[str, float]:
        """For health."""
        return {
            "offset_ns": self.offset_ns,
            "drift_ppm": round(self.drift_ppm, 3),
            "uncertainty_us": round(self.uncertainty_us, 1),
            "steps": self.steps,
        }

    def _is_step(self, t_us: int, host_ns: int) -> bool:
        delay_ns = host_ns - self.host_ns(t_us)
        if t_us < self._newest_us or delay_ns < -self.params.early_step_ns:
            return True
        if delay_ns <= self.params.late_step_ns:
            self._late_since = None
            return False
        if self._late_since is None:
            self._late_since = t_us
        return t_us - self._late_since >= self.params.late_buckets * self.params.bucket_us

    def _add(self, t_us: int, host_ns: int) -> None:
        skew_ns = host_ns - t_us * 1000
        bucket = t_us // self.params.bucket_us
        first = not self._lowest
        newest = None if first else self._lowest[-1]
        self._newest_us = t_us
        if newest is None or newest.bucket != bucket:
            if not first:
                self._fit()
            self._lowest.append(_Lowest(bucket, t_us, skew_ns))
        elif skew_ns - newest.skew_ns < self._drift * (t_us - newest.t_us) * 1000:
            newest.t_us, newest.skew_ns = t_us, skew_ns
        if first:
            self._reference_us, self._offset_ns = t_us, skew_ns
        below_ns = self.host_ns(t_us) - host_ns
        if below_ns > 0:
            # at once, not only at the end of the bucket: no datum arrives before it was sent
            self._offset_ns -= below_ns

    def _fit(self) -> None:
        """Line below all lowest points, at the smallest mean distance."""
        points = self._lowest
        span_us = points[-1].t_us - points[0].t_us
        if span_us >= self.params.drift_span_us:
            limit = self.params.max_drift_ppm * 1e-6
            self._drift = min(max(_hull_slope(points), -limit), limit)
        self._reference_us = points[-1].t_us
        above = [p.skew_ns - self._drift * (p.t_us - self._reference_us) * 1000 for p in points]
        lowest = min(above)
        self._offset_ns = round(lowest)
        self._spread_ns = sum(above) / len(above) - lowest


def _hull_slope(points: deque[_Lowest]) -> float:
    """Slope (ns per ns) of the edge of the lower convex hull that lies over the mean of the times."""
    hull: list[_Lowest] = []
    for p in points:
        while len(hull) >= 2:
            a, b = hull[-2], hull[-1]
            if (b.skew_ns - a.skew_ns) * (p.t_us - a.t_us) < (p.skew_ns - a.skew_ns) * (b.t_us - a.t_us):
                break
            hull.pop()
        hull.append(p)
    mean_us = sum(p.t_us for p in points) / len(points)
    for a, b in pairwise(hull):
        if b.t_us >= mean_us:
            return (b.skew_ns - a.skew_ns) / ((b.t_us - a.t_us) * 1000)
    return 0.0
