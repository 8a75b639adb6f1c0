"""When to ask for a segmentation, and what to do when none comes: one request at a time, retries with back-off."""

from __future__ import annotations

from dataclasses import replace

from motiondlo.fusion.params import FusionParams
from motiondlo.fusion.state import FrameRequest


class RequestPlanner:
    """Keeps at most one segmentation under way. All times are event microseconds that come in with the data.

    A request is for some DLOs (or for none in particular) and is cancelled when all of them move again: what was not
    sent is forgotten, what was sent is no longer waited for, and whoever works on it may be told to stop
    (:meth:`withdrawn`). If its answer comes it is welcome all the same; it just does not count as that of a later one.
    """

    def __init__(self, params: FusionParams) -> None:
        self._retry_first_us = int(params.retry_first_ms * 1000)
        self._retry_max_us = int(params.retry_max_ms * 1000)
        self._timeout_us = int(params.request_timeout_s * 1e6)
        self._wanted: FrameRequest | None = None
        self._sent: FrameRequest | None = None
        self._asked_us = 0
        self._not_before_us: int | None = None
        self._number = 0
        self.failures_in_a_row = 0
        self.failures = 0
        self.cancelled = 0
        self._withdrawn: list[int] = []

    def want(self, reason: str, after_us: int, ids: frozenset[int] = frozenset()) -> None:
        """Wish for a segmentation; a newer wish takes the place of one that was not sent yet, and its DLOs."""
        if self._wanted is not None:
            ids |= self._wanted.ids
        self._wanted = FrameRequest(reason, after_us, ids)

    @property
    def idle(self) -> bool:
        """Nothing wished for and nothing under way."""
        return self._wanted is None and self._sent is None

    @property
    def under_way(self) -> FrameRequest | None:
        """The request whose answer is waited for."""
        return self._sent

    def stirred(self, ids: frozenset[int]) -> None:
        """These DLOs move (again): requests that are for none but them are cancelled."""
        if self._wanted is not None and self._wanted.ids:
            left = self._wanted.ids - ids
            self.cancelled += int(not left)
            self._wanted = replace(self._wanted, ids=left) if left else None
        if self._sent is not None and self._sent.ids:
            left = self._sent.ids - ids
            if not left:
                self.cancelled += 1
                self._withdrawn.append(self._sent.number)
            self._sent = replace(self._sent, ids=left) if left else None

    def withdrawn(self) -> tuple[int, ...]:
        """Numbers of the requests that were sent and cancelled since the last call."""
        numbers, self._withdrawn = tuple(self._withdrawn), []
        return numbers

    def due(self, now_us: int) -> FrameRequest | None:
        """The request to send now, if any; it counts as under way from then on."""
        if self._sent is not None:
            if now_us - self._asked_us < self._timeout_us:
                return None
            self._failed(now_us)
        if self._wanted is None or (self._not_before_us is not None and now_us < self._not_before_us):
            return None
        self._number += 1
        self._sent, self._wanted = replace(self._wanted, number=self._number), None
        self._asked_us = now_us
        return self._sent

    def arrived(self, ok: bool, now_us: int, number: int | None = None) -> None:
        """The answer to request ``number`` (None: to the one under way) came, good or not.

        After a bad one the same is wished for again, later; a bad one that is no longer waited for changes nothing.
        """
        awaited = self._sent is not None and number in (None, self._sent.number)
        if ok:
            self.failures_in_a_row = 0
            self._not_before_us = None
            if awaited:
                self._sent = None
        elif awaited or number is None:
            self._failed(now_us)

    def _failed(self, now_us: int) -> None:
        sent, self._sent = self._sent, None
        self.failures += 1
        self.failures_in_a_row += 1
        pause = min(self._retry_first_us << min(self.failures_in_a_row - 1, 20), self._retry_max_us)
        self._not_before_us = now_us + pause
        if self._wanted is None:
            self._wanted = FrameRequest("retry", max(now_us, -1), frozenset() if sent is None else sent.ids)
