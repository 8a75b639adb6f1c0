"""systemd's notification protocol (sd_notify): READY, WATCHDOG, STOPPING, STATUS over a datagram socket.

Own code because the packages for it block when the socket is full, or swallow errors; a daemon must do neither.
"""

from __future__ import annotations

import os
import socket


class Notifier:
    """Tells the service manager how the daemon is; does nothing when there is no service manager."""

    def __init__(self, address: str | None = None) -> None:
        """``address``: the socket's path (a leading ``@`` means abstract); None takes it from NOTIFY_SOCKET."""
        address = os.environ.get("NOTIFY_SOCKET", "") if address is None else address
        self._address = "\0" + address[1:] if address.startswith("@") else address
        self._socket: socket.socket | None = None
        self.lost = 0
        if self._address:
            self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM | socket.SOCK_CLOEXEC)
            self._socket.setblocking(False)

    def send(self, *assignments: str) -> None:
        """Send lines such as ``READY=1``; one that cannot be sent now is counted in ``lost``, never waited for."""
        if self._socket is None:
            return
        try:
            self._socket.sendto("\n".join(assignments).encode(), self._address)
        except OSError:
            self.lost += 1

    def close(self) -> None:
        """Close the socket."""
        if self._socket is not None:
            self._socket.close()
            self._socket = None
