"""A cut-off between this process and another one: bytes pass both ways until :meth:`Relay.cut`.

Rerun's SDK waits for ever on a viewer that hangs, also at the end of the process; it does not on one that is gone. With the
relay between them, a viewer that hangs can be made one that is gone.
"""

from __future__ import annotations

import contextlib
import socket
import threading

_CHUNK = 1 << 16


class Relay:
    """Listens on a free local port and passes every connection on to one address."""

    def __init__(self, host: str, port: int) -> None:
        """Start listening; nobody is connected yet."""
        self._to = (host, port)
        self._listener = socket.create_server(("127.0.0.1", 0))
        self._sockets: list[socket.socket] = [self._listener]
        self.port: int = self._listener.getsockname()[1]
        threading.Thread(target=self._serve, daemon=True).start()

    def cut(self) -> None:
        """Close every connection and take no more."""
        for each in self._sockets:
            with contextlib.suppress(OSError):
                each.shutdown(socket.SHUT_RDWR)
            each.close()

    def _serve(self) -> None:
        with contextlib.suppress(OSError):
            while True:
                here, _ = self._listener.accept()
                self._sockets.append(here)
                there = socket.create_connection(self._to)
                self._sockets.append(there)
                for source, sink in ((here, there), (there, here)):
                    threading.Thread(target=_pump, args=(source, sink), daemon=True).start()


def _pump(source: socket.socket, sink: socket.socket) -> None:
    with contextlib.suppress(OSError):
        while data := source.recv(_CHUNK):
            sink.sendall(data)
    for each in (source, sink):  # the end of one direction is the end of both
        with contextlib.suppress(OSError):
            each.shutdown(socket.SHUT_RDWR)
