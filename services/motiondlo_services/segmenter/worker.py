"""A backend in a process of its own: it loads in the background, and its time limit holds whatever it does."""

from __future__ import annotations

import socket
import subprocess
import sys
import time
from collections.abc import Callable
from contextlib import suppress
from enum import StrEnum
from typing import Any

import numpy as np
import numpy.typing as npt

from motiondlo.frames.backend import BackendUnavailable
from motiondlo.frames.checks import FrameFailure
from motiondlo.frames.masks import MaskSet
from motiondlo.frames.params import FrameParams
from motiondlo_services.segmenter.channel import Channel, ChannelClosed
from motiondlo_services.segmenter.worker_process import CANCEL_SIGNAL, decode_masks
from motiondlo_services.supervisor import describe_exit

Image = npt.NDArray[np.uint8]


class WorkerState(StrEnum):
    """What the worker is doing; the value is what health shows."""

    LOADING = "loading"
    READY = "ready"
    STOPPED = "stopped"
    """It failed; the frame after the one that is told so starts it again."""


class WorkerBackend:
    """A segmenter backend that hands every frame to a worker process, and ends it when it takes too long."""

    def __init__(self, params: FrameParams, pulse: Callable[[], None] = lambda: None) -> None:
        """Starts to load at once. ``pulse`` is called about ten times a second while a frame is waited for; what it
        raises ends the waiting.
        """
        self._params = params
        self._pulse = pulse
        self._child: subprocess.Popen[bytes] | None = None
        self._channel: Channel | None = None
        self._load_until_s = 0.0
        self.trouble = ""
        """Why it is stopped."""
        self._said = True
        self._cancelled = False
        self.state = WorkerState.STOPPED
        self.restarts = -1
        self._start()

    @property
    def name(self) -> str:
        """The backend's own name."""
        return self._params.backend

    @property
    def pid(self) -> int | None:
        """Process id of the worker while it runs."""
        return None if self._child is None else self._child.pid

    def segment(self, image_bgr: Image, background: Image | None, frame_name: str) -> MaskSet:
        """As the backend does.

        Raises BackendUnavailable: the model is still loading, or could not be loaded; the frame took too long; the
        worker has ended. RuntimeError with what the backend said when it raised.
        """
        if self.state is WorkerState.STOPPED and self._said:
            self._start()
        if self.poll() is WorkerState.STOPPED:
            # Every end is told once before a new worker starts, so that it counts, and causes a pause.
            raise self._telling(FrameFailure.BACKEND_FAILED)
        if self.state is WorkerState.LOADING or self._channel is None:
            raise BackendUnavailable(FrameFailure.STILL_LOADING, f"{self.name} is still loading its model")
        # The empty board stays here: backends with a model see the frame alone.
        request = {"image": _encoded(image_bgr), "frame_name": frame_name}
        self._cancelled = False
        until_s = time.monotonic() + self._params.time_limit_s
        try:
            self._channel.put(request, until_s, self._pulse)
            answer = self._channel.get(until_s, self._pulse)
        except TimeoutError:
            self.stop(f"{self.name} took longer than {self._params.time_limit_s:g} s")
            raise self._telling(FrameFailure.TIMED_OUT) from None
        except ChannelClosed:
            self.stop("")
            raise self._telling(FrameFailure.BACKEND_FAILED) from None
        except BaseException:
            # Whoever interrupts the waiting leaves an answer on its way: it must not be taken for the next frame's.
            self.stop("interrupted")
            raise
        if self._cancelled or "cancelled" in answer:
            raise BackendUnavailable(FrameFailure.CANCELLED, "nobody needs it any more")
        if "error" in answer:
            raise RuntimeError(answer["error"])
        return decode_masks(answer)

    def cancel(self) -> None:
        """Nobody needs the frame that is waited for: to be called from ``pulse``.

        The worker stops between two operations of its model and keeps the model; where it cannot, its answer is thrown
        away, and the time limit holds as ever.
        """
        self._cancelled = True
        if self._child is not None:
            self._child.send_signal(CANCEL_SIGNAL)

    def poll(self) -> WorkerState:
        """Notice that the model is loaded, that it cannot be, or that the worker has ended; never waits."""
        if self.state is WorkerState.LOADING and self._channel is not None:
            if self._channel.readable():
                self._take_greeting(self._channel)
            elif time.monotonic() > self._load_until_s:
                self.stop(f"{self.name} was not loaded within {self._params.load_limit_s:g} s")
        elif self.state is WorkerState.READY and self._channel is not None and self._channel.readable():
            self.stop("")  # it says nothing unasked: this is its end
        return self.state

    def stop(self, why: str = "closed") -> None:
        """End the worker at once; an empty ``why`` stands for the way in which it ended by itself."""
        if self._channel is not None:
            self._channel.close()
            self._channel = None
        if self._child is not None:
            if not why:
                with suppress(subprocess.TimeoutExpired):
                    self._child.wait(1.0)
            code = self._child.poll()
            if code is None:
                self._child.kill()
                self._child.wait()
            why = why or f"the worker of {self.name} ended with {describe_exit(-9 if code is None else code)}"
            self._child = None
        self.trouble = why
        self._said = False
        self.state = WorkerState.STOPPED

    def _telling(self, failure: FrameFailure) -> BackendUnavailable:
        self._said = True
        return BackendUnavailable(failure, self.trouble)

    def _start(self) -> None:
        mine, theirs = socket.socketpair()
        with theirs:
            module = "motiondlo_services.segmenter.worker_process"
            self._child = subprocess.Popen(
                [sys.executable, "-m", module, str(theirs.fileno())],
                pass_fds=(theirs.fileno(),),
                stdin=subprocess.DEVNULL,
            )
        self._channel = Channel(mine)
        self._load_until_s = time.monotonic() + self._params.load_limit_s
        self.state = WorkerState.LOADING
        self.restarts += 1
        # A few kB: they fit into the socket before the worker reads.
        with suppress(ChannelClosed):
            self._channel.put({"params": self._params.model_dump_json()}, self._load_until_s, self._pulse)

    def _take_greeting(self, channel: Channel) -> None:
        try:
            greeting: dict[str, Any] = channel.get(self._load_until_s, self._pulse)
        except (ChannelClosed, TimeoutError):
            self.stop("")
            return
        if "error" in greeting:
            self.stop(greeting["error"])
            return
        self.state = WorkerState.READY


def _encoded(image: Image) -> list[Any]:
    return [image.shape[0], image.shape[1], np.ascontiguousarray(image).tobytes()]
