"""Pairs frames with triggers by time, and decides which frame a request gets. No I/O, no clock."""

from __future__ import annotations

from bisect import bisect_left
from dataclasses import dataclass

from motiondlo.recording.layout import FrameEntry
from motiondlo.rejects import RejectCounter, RejectReason


@dataclass(frozen=True)
class Capture:
    """A frame to hand out, and the request that it answers (0: nobody asked, it is for the recorder)."""

    entry: FrameEntry
    request_id: int


@dataclass(frozen=True)
class _Request:
    request_id: int
    after_us: int


class CaptureCore:
    """Knows the frames of a recording by trigger time; a frame exists from its trigger on.

    A frame belongs to the trigger nearest in time, within ``tolerance_us``: a dropped trigger or frame leaves its
    partner alone (counted) and never shifts the others by one.
    """

    def __init__(self, frames: tuple[FrameEntry, ...], tolerance_us: int, publish_all: bool = False) -> None:
        self._frames = frames
        self._times = [entry.t_us for entry in frames]
        self._tolerance_us = tolerance_us
        self._publish_all = publish_all
        self._taken = 0
        self._newest: FrameEntry | None = None
        self._request: _Request | None = None
        self.rejects = RejectCounter()
        self.triggers = 0

    @property
    def waiting(self) -> bool:
        """A request waits for its frame."""
        return self._request is not None

    def on_trigger(self, t_us: int) -> list[Capture]:
        """The exposure of a frame starts at ``t_us``; the frames to hand out now."""
        self.triggers += 1
        k = bisect_left(self._times, t_us - self._tolerance_us)
        self._pass_over(k)
        if k >= len(self._times) or self._times[k] > t_us + self._tolerance_us:
            self.rejects.count(RejectReason.TRIGGER_WITHOUT_FRAME)
            return []
        entry = self._frames[k]
        self._newest = entry
        self._taken = k + 1
        captures = self._answer()
        if self._publish_all and not captures:
            captures = [Capture(entry, 0)]
        return captures

    def on_request(self, request_id: int, after_us: int) -> list[Capture]:
        """Somebody wants the newest frame taken at or after ``after_us`` (-1: any, also one that is yet to be taken).

        A newer request replaces one that still waits.
        """
        self._request = _Request(request_id, after_us)
        if after_us < 0 and self._newest is None and self._frames:
            # Before its first trigger a recording's scene is at rest, as its first frame shows it.
            self._request = None
            return [Capture(self._frames[0], request_id)]
        return self._answer()

    def withdraw(self, request_id: int) -> None:
        """Nobody needs the frame of this request any more."""
        if self._request is not None and self._request.request_id == request_id:
            self._request = None

    def skip(self, entry: FrameEntry, reason: RejectReason) -> None:
        """A frame could not be read: counted, and the request goes on to the next one."""
        self.rejects.count(reason)
        if self._newest == entry:
            self._newest = None

    def ask_again(self, request_id: int, after_us: int) -> None:
        """Let a request wait for the next trigger."""
        self._request = _Request(request_id, after_us)

    def _answer(self) -> list[Capture]:
        request, entry = self._request, self._newest
        if request is None or entry is None or entry.t_us < request.after_us:
            return []
        self._request = None
        return [Capture(entry, request.request_id)]

    def _pass_over(self, k: int) -> None:
        missed = k - self._taken
        if missed > 0:
            self.rejects.count(RejectReason.FRAME_WITHOUT_TRIGGER, n=missed)
            self._taken = k
