"""The worker: loads the model of a backend and segments what it is given, one frame after the other.

Started by :mod:`motiondlo_services.segmenter.worker` with the number of a socket; it ends when that closes. Whatever
happens here (a hang, a crash, memory that runs out) happens to this process alone.
"""

from __future__ import annotations

import math
import signal
import socket
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType
from typing import Any

import numpy as np

from motiondlo.errors import MotionDLOError
from motiondlo.frames.backend import SegmenterBackend, create_backend
from motiondlo.frames.masks import MaskSet, ScoredMask
from motiondlo.frames.params import FrameParams
from motiondlo_services.runtime.shutdown import die_with_parent
from motiondlo_services.segmenter.channel import Channel, ChannelClosed

CANCEL_SIGNAL = signal.SIGUSR1
"""Stop the frame at hand; nothing happens where there is none."""


class _Cancelled(BaseException):
    """The frame at hand is not needed any more."""


def main(argv: list[str]) -> int:
    """``argv``: the socket's number. Returns the exit code."""
    signal.signal(CANCEL_SIGNAL, signal.SIG_IGN)
    die_with_parent()
    channel = Channel(socket.socket(fileno=int(argv[0])))
    try:
        params = FrameParams.model_validate_json(_get(channel)["params"])
        backend = _load(channel, params)
        while backend is not None:
            _put(channel, _answer(backend, _get(channel)))
    except ChannelClosed:
        return 0
    return 1


def encode_masks(found: MaskSet) -> dict[str, Any]:
    """Eight pixels a byte."""
    return {
        "masks": [[*m.mask.shape, m.score, np.packbits(m.mask).tobytes()] for m in found.masks],
        "obstacles": None
        if found.obstacles is None
        else [*found.obstacles.shape, np.packbits(found.obstacles).tobytes()],
        "stages_ns": dict(found.stages_ns),
    }


def decode_masks(message: dict[str, Any]) -> MaskSet:
    """The inverse of ``encode_masks``."""
    obstacles = message["obstacles"]
    return MaskSet(
        tuple(ScoredMask(_unpack(height, width, bits), score) for height, width, score, bits in message["masks"]),
        None if obstacles is None else _unpack(*obstacles),
        message["stages_ns"],
    )


def _unpack(height: int, width: int, bits: bytes) -> np.ndarray[tuple[int, ...], np.dtype[np.uint8]]:
    return np.unpackbits(np.frombuffer(bits, np.uint8), count=height * width).reshape(height, width)


def _load(channel: Channel, params: FrameParams) -> SegmenterBackend | None:
    try:
        backend = create_backend(params)
    except MotionDLOError as error:
        _put(channel, {"error": str(error)})
        return None
    except Exception as error:  # noqa: BLE001 -- the segmenter has to hear of it, whatever it is
        _put(channel, {"error": f"{type(error).__name__}: {error}"})
        return None
    _put(channel, {"loaded": True})
    return backend


def _answer(backend: SegmenterBackend, request: dict[str, Any]) -> dict[str, Any]:
    try:
        image = _image(request["image"])
        with _cancellable():
            found = backend.segment(image, None, request["frame_name"])
        return encode_masks(found)
    except _Cancelled:
        signal.signal(CANCEL_SIGNAL, signal.SIG_IGN)  # it may have come while the handler was taken away
        return {"cancelled": True}
    except Exception as error:  # noqa: BLE001 -- as above
        return {"error": f"{type(error).__name__}: {error}"}


@contextmanager
def _cancellable() -> Iterator[None]:
    """Within it the signal raises _Cancelled, as soon as the interpreter is back from what the model is doing."""

    def stop(signum: int, frame: FrameType | None) -> None:
        raise _Cancelled

    signal.signal(CANCEL_SIGNAL, stop)
    try:
        yield
    finally:
        signal.signal(CANCEL_SIGNAL, signal.SIG_IGN)


def _image(encoded: list[Any]) -> np.ndarray[tuple[int, ...], np.dtype[np.uint8]]:
    height, width, data = encoded
    return np.frombuffer(data, np.uint8).reshape(height, width, 3)


def _get(channel: Channel) -> dict[str, Any]:
    return channel.get(math.inf, lambda: None)


def _put(channel: Channel, message: dict[str, Any]) -> None:
    channel.put(message, math.inf, lambda: None)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
