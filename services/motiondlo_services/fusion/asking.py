"""Asks for segmentations from a thread of its own, so that the state never waits for an answer."""

from __future__ import annotations

from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import suppress

from motiondlo.bus.errors import CommandError
from motiondlo.bus.session import Bus
from motiondlo.fusion.state import FrameRequest

TIMEOUT_S = 2.0


class FrameAsker:
    """One request under way at a time; says when one was not taken, so that it can be made again."""

    def __init__(self, bus: Bus) -> None:
        self._bus = bus
        self._pool = ThreadPoolExecutor(1, thread_name_prefix="ask")
        self._answer: Future[str] | None = None
        self.last_error = ""
        self.number = 0
        """Of the last request."""

    def ask(self, request: FrameRequest, request_id: str) -> None:
        """Ask frame-capture for a frame; it hands it to the segmenter."""
        self.number = request.number
        self._answer = self._pool.submit(self._ask, request, request_id)

    def withdraw(self, request_id: str) -> None:
        """Tell frame-capture and the segmenter that nobody needs the answer any more; whether they hear it or not."""
        self._pool.submit(self._tell, {"cancel": request_id})

    @property
    def busy(self) -> bool:
        """The last request has not been answered yet."""
        return self._answer is not None and not self._answer.done()

    def failed(self) -> bool:
        """Whether the last request was refused or not answered; says so once."""
        if self._answer is None or not self._answer.done():
            return False
        self.last_error = self._answer.result()
        self._answer = None
        return bool(self.last_error)

    def _ask(self, request: FrameRequest, request_id: str) -> str:
        args = {"after_us": request.after_us, "request_id": request_id}
        try:
            self._bus.ask("segment", args, target="frame-capture", timeout_s=TIMEOUT_S)
        except CommandError as error:
            return str(error)
        return ""

    def _tell(self, args: dict[str, str]) -> None:
        with suppress(CommandError):
            self._bus.ask("segment", args, timeout_s=TIMEOUT_S)

    def close(self) -> None:
        """Wait for the request under way."""
        self._pool.shutdown()
