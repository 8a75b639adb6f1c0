"""Reads the RGB camera in a thread of its own, so that requests and triggers never wait for it."""

from __future__ import annotations

import threading
import time

from motiondlo.bus.inbox import Inbox
from motiondlo.cameras.interface import Frame
from motiondlo.cameras.link import CameraLink, LinkReport

READ_S = 0.05
MAX_PAUSE_S = 0.1
QUEUE = 8
"""Frames that may wait to be paired; beyond it the oldest are dropped, which the frame counter shows."""
JOIN_S = 3.0


class FrameReader:
    """Frames arrive in ``inbox``, each with the number of the connection it came over."""

    def __init__(self, link: CameraLink[Frame]) -> None:
        self._link = link
        self._running = True
        self.inbox: Inbox[tuple[int, Frame]] = Inbox(QUEUE)
        self._thread = threading.Thread(target=self._run, name="frame reader", daemon=True)
        self._thread.start()

    @property
    def report(self) -> LinkReport:
        """How the connection is."""
        return self._link.report

    def _run(self) -> None:
        while self._running:
            frame = self._link.read(READ_S)
            if frame is not None:
                self.inbox.put((self._link.report.connections, frame))
            elif (pause_s := self._link.pause_s) > 0:
                time.sleep(min(pause_s, MAX_PAUSE_S))
        self._link.close()

    def close(self) -> None:
        """End the thread, which closes the camera."""
        self._running = False
        self._thread.join(JOIN_S)
        if not self._thread.is_alive():
            self.inbox.close()
