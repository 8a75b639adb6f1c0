"""When to ask for a segmentation, and what to do when none comes: one request at a time, retries with back-off."""

from __future__ import annotations

from motiondlo.fusion.params import FusionParams
from motiondlo.fusion.state import FrameRequest


class RequestPlanner:
    """Keeps at most one segmentation under way. All times are event microseconds that come in with the data."""

    def __init__(self, params: FusionParams) -> None:
        self._retry_first_us = int(params.retry_first_ms * 1000)
        self._retry_max_us = int(params.retry_max_ms * 1000)
        self._timeout_us = int(params.request_timeout_s * 1e6)
        self._wanted: FrameRequest | None = None
        self._asked_us: int | None = None
        self._not_before_us: int | None = None
        self.failures_in_a_row = 0
        self.failures = 0

    def want(self, reason: str, after_us: int) -> None:
        """Wish for a segmentation; a newer wish replaces one that was not sent yet."""
        self._wanted = FrameRequest(reason, after_us)

    @property
    def idle(self) -> bool:
        """Nothing wished for and nothing under way."""
        return self._wanted is None and self._asked_us is None

    def due(self, now_us: int) -> FrameRequest | None:
        """The request to send now, if any; it counts as under way from then on."""
        if self._asked_us is not None:
            if now_us - self._asked_us < self._timeout_us:
                return None
            self._asked_us = None
            self._failed(now_us)
        if self._wanted is None or (self._not_before_us is not None and now_us < self._not_before_us):
            return None
        request, self._wanted = self._wanted, None
        self._asked_us = now_us
        return request

    def arrived(self, ok: bool, now_us: int) -> None:
        """A segmentation came back, good or not; after a bad one the same is wished for again, later."""
        self._asked_us = None
        if ok:
            self.failures_in_a_row = 0
            self._not_before_us = None
        else:
            self._failed(now_us)

    def _failed(self, now_us: int) -> None:
        self.failures += 1
        self.failures_in_a_row += 1
        pause = min(self._retry_first_us << min(self.failures_in_a_row - 1, 20), self._retry_max_us)
        self._not_before_us = now_us + pause
        if self._wanted is None:
            self._wanted = FrameRequest("retry", max(now_us, -1))
