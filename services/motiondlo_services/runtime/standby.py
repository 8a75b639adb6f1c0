"""One process of a daemon works; a second one may stand by, loaded and warm, and takes over when the first one ends.

The right to work is a name in the kernel's abstract socket namespace: only one process can hold it, and the kernel
takes it back from a process that ends, however it ends. So no file is left over, and neither process needs to know of
the other or of who started them: two units of systemd do, or the desk supervisor.

Considered and rejected: a guardian that forks loaded children (a session of the bus does not survive a fork, and the
guardian itself would be the process that must not die); a pipe from the supervisor (there is none under systemd).
"""

from __future__ import annotations

import errno
import os
import socket
import time
from collections.abc import Callable

LOOK_S = 0.01
"""How soon after its end the first process is missed."""
ALIVE_S = 0.5


class Turn:
    """The right to be the working process of one daemon of one cell; held until the process ends."""

    def __init__(self, endpoint: str) -> None:
        """``endpoint``: where the daemon listens; no two cells of a machine have the same."""
        self._address = f"\0motiondlo/{os.getuid()}/{endpoint}"
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM | socket.SOCK_CLOEXEC)

    def take(self) -> bool:
        """Whether this process has the turn from now on. Raises OSError for anything but its being taken."""
        try:
            self._socket.bind(self._address)
        except OSError as error:
            if error.errno == errno.EADDRINUSE:
                return False
            raise
        return True

    def wait(
        self,
        running: Callable[[], bool],
        on_wait: Callable[[], None],
        sleep: Callable[[float], None] = time.sleep,
        now: Callable[[], float] = time.monotonic,
    ) -> bool:
        """Wait for the turn; False when ``running`` says to stop first. ``on_wait`` is called twice a second."""
        next_s = now()
        while not self.take():
            if not running():
                return False
            if now() >= next_s:
                on_wait()
                next_s = now() + ALIVE_S
            sleep(LOOK_S)
        return True

    def close(self) -> None:
        """Let another process have it."""
        self._socket.close()
