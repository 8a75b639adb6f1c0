"""Messages over a socket between the segmenter and its worker; every wait has an end, and a pulse while it lasts."""

from __future__ import annotations

import select
import socket
import time
from collections.abc import Callable
from typing import Any

import msgpack

_LENGTH_BYTES = 8
_MAX_BYTES = 1 << 30
_PULSE_S = 0.1
_PIECE = 1 << 20


class ChannelClosed(Exception):
    """The other side is gone."""


class Channel:
    """msgpack maps, each after its length."""

    def __init__(self, end: socket.socket) -> None:
        end.setblocking(False)
        self._socket = end

    def put(self, message: dict[str, Any], until_s: float, pulse: Callable[[], None]) -> None:
        """Send; ``until_s`` is a time of the monotonic clock, ``pulse`` is called about ten times a second.

        Raises TimeoutError when the other side does not take it in time, ChannelClosed when it is gone.
        """
        body = msgpack.packb(message)
        left = memoryview(len(body).to_bytes(_LENGTH_BYTES, "little") + body)
        while left:
            self._wait(True, until_s, pulse)
            try:
                left = left[self._socket.send(left[:_PIECE]) :]
            except BlockingIOError:
                continue
            except OSError as error:
                raise ChannelClosed from error

    def get(self, until_s: float, pulse: Callable[[], None]) -> dict[str, Any]:
        """The next message. Raises TimeoutError and ChannelClosed as ``put`` does."""
        length = int.from_bytes(self._read(_LENGTH_BYTES, until_s, pulse), "little")
        if length > _MAX_BYTES:
            raise ChannelClosed
        message = msgpack.unpackb(self._read(length, until_s, pulse))
        if not isinstance(message, dict):
            raise ChannelClosed
        return message

    def readable(self) -> bool:
        """Whether a message, or the end, has begun to arrive."""
        return bool(select.select([self._socket], [], [], 0.0)[0])

    def close(self) -> None:
        """Close this end."""
        self._socket.close()

    def _read(self, count: int, until_s: float, pulse: Callable[[], None]) -> bytes:
        parts = bytearray()
        while len(parts) < count:
            self._wait(False, until_s, pulse)
            try:
                part = self._socket.recv(min(count - len(parts), _PIECE))
            except BlockingIOError:
                continue
            except OSError as error:
                raise ChannelClosed from error
            if not part:
                raise ChannelClosed
            parts += part
        return bytes(parts)

    def _wait(self, writing: bool, until_s: float, pulse: Callable[[], None]) -> None:
        mine = [self._socket]
        while True:
            left_s = until_s - time.monotonic()
            pause_s = min(max(left_s, 0.0), _PULSE_S)
            read, write, _ = select.select([] if writing else mine, mine if writing else [], [], pause_s)
            if read or write:
                return
            if left_s <= 0.0:
                raise TimeoutError
            pulse()
