"""The Rerun viewer as a program, and a run streamed to an open one: if that is missing, closes or hangs, the run goes on."""

from __future__ import annotations

import logging
import os
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from threading import Lock
from typing import TYPE_CHECKING

from ffsm_mj.arrays import FloatArray
from ffsm_mj.errors import InputError
from ffsm_mj.log.recorder import Sink
from ffsm_mj.model.system import System
from ffsm_mj.records.events import Event, OutcomeRecord
from ffsm_mj.records.run_log import RunHeader

if TYPE_CHECKING:
    from ffsm_mj.log.rerun.sink import RerunSink


LOCAL_ADDRESS = "127.0.0.1"
"""Default address on which a viewer listens: not reachable from other machines."""

_VARIABLE = "RUST_LOG"
_ONE_AT_A_TIME = Lock()


def has_display() -> bool:
    """Whether a window can open on this machine."""
    return not sys.platform.startswith("linux") or any(os.environ.get(name) for name in ("DISPLAY", "WAYLAND_DISPLAY"))


def viewer_command(*arguments: str, listen: str = LOCAL_ADDRESS) -> list[str]:
    """Command line of the viewer installed with this Python.

    Args:
        arguments: Arguments of the viewer.
        listen: Address on which it accepts data; the viewer's own default is all addresses of the machine.
    """
    return [sys.executable, "-m", "rerun", "--bind", listen, *arguments]


@contextmanager
def rust_log(level: str) -> Iterator[None]:
    """Set the log level of Rerun's SDK if it is first imported in this context; a ``RUST_LOG`` of the user wins.

    The SDK reads ``RUST_LOG`` once, at import. The environment is restored.
    """
    with _ONE_AT_A_TIME:
        if _VARIABLE in os.environ:
            yield
            return
        os.environ[_VARIABLE] = level
        try:
            yield
        finally:
            del os.environ[_VARIABLE]


_LOG = logging.getLogger("ffsm_mj")
_CONNECT_S = 0.5
_START_S = 15.0
_CHECK_PERIOD_S = 0.2
_PATIENCE_S = 2.0
_CHUNK = 1 << 16


def split_address(address: str) -> tuple[str, int]:
    """Host and port of ``host:port``.

    Raises:
        InputError: The text is not such an address.
    """
    host, _, port = address.rpartition(":")
    if not host or not port.isdecimal():
        raise InputError(f"{address}: not the address of a viewer; write host:port, e.g. 127.0.0.1:9876")
    return host, int(port)


class LiveSink(Sink):
    """Sink that sends a run to a viewer; the first failure gives a warning and ends the stream."""

    def __init__(self, address: str, system: System, view_rate_hz: float, view: Sequence[float] | None = None) -> None:
        """Remember the address; nothing is sent yet.

        Args:
            address: ``host:port`` of the viewer.
            system: The system to draw.
            view_rate_hz: Frames per second of simulation time.
            view: Direction towards the camera; None: the one that shows most.

        Raises:
            InputError: The address is not ``host:port``.
        """
        self._address, (self._host, self._port) = address, split_address(address)
        self._system, self._rate, self._view = system, view_rate_hz, view
        self._sink: RerunSink | None = None
        self._relay: Relay | None = None
        self._next_check = 0.0

    def open(self, header: RunHeader) -> None:
        """Connect to the viewer, or start one if there is a display."""
        if not self._listens() and not self._started():
            self._give_up(f"no Rerun viewer at {self._address}, and none could be started (no display?)")
            return
        # A lost connection is reported in one line below; the SDK would report it in several.
        with rust_log("warn,re_grpc_client=off,re_sdk=off,re_quota_channel=off"):
            from ffsm_mj.log.rerun.sink import RerunSink  # importing it takes a second

        self._relay = Relay(self._host, self._port)
        viewer = f"rerun+http://127.0.0.1:{self._relay.port}/proxy"
        self._sink = RerunSink(viewer, self._system, self._rate, self._view)
        self._guarded(lambda sink: sink.open(header))

    def rows(self, block: FloatArray) -> None:
        """Send the frames of a block."""
        self._guarded(lambda sink: sink.rows(block))

    def event(self, event: Event) -> None:
        """Send an event."""
        self._guarded(lambda sink: sink.event(event))

    def flush(self) -> None:
        """Send the buffered frames, and check that the viewer accepts them."""
        self._guarded(lambda sink: sink.flush())
        self._guarded(lambda sink: sink.wait(_PATIENCE_S))

    def close(self, outcome: OutcomeRecord | None) -> None:
        """Send the end of the run."""
        self.flush()
        self._guarded(lambda sink: sink.close(outcome))
        self._sink = None

    def _guarded(self, act: Callable[[RerunSink], None]) -> None:
        # The SDK need not raise when its viewer is gone, so the address is checked now and then.
        now = time.monotonic()
        if self._sink is not None and now >= self._next_check:
            self._next_check = now + _CHECK_PERIOD_S
            if not self._listens():
                self._give_up(f"the Rerun viewer at {self._address} is gone")
        if self._sink is None:
            return
        try:
            act(self._sink)
        except Exception as error:  # noqa: BLE001 (no failure of a viewer may end the run)
            self._give_up(f"the Rerun viewer at {self._address} accepts no more data ({error})")

    def _give_up(self, reason: str) -> None:
        sink, self._sink = self._sink, None
        if self._relay is not None:
            self._relay.cut()
        if sink is not None:
            sink.disconnect()
        _LOG.warning("%s; the run continues without it", reason)

    def _listens(self) -> bool:
        try:
            with socket.create_connection((self._host, self._port), timeout=_CONNECT_S):
                return True
        except OSError:
            return False

    def _started(self) -> bool:
        """Start a viewer on this machine; False if that is impossible."""
        if self._host not in {"127.0.0.1", "localhost"} or not has_display():
            return False
        command = viewer_command("--port", str(self._port), "--expect-data-soon")
        viewer = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, start_new_session=True)
        end = time.monotonic() + _START_S
        while time.monotonic() < end and viewer.poll() is None:
            if self._listens():
                return True
            time.sleep(0.05)
        return False


class Relay:
    """Listens on a free local port and forwards every connection to one address until it is cut.

    Rerun's SDK waits forever for a viewer that hangs, even at the end of the process, but not for one that has closed its
    connection. Cutting the relay turns the first case into the second.
    """

    def __init__(self, host: str, port: int) -> None:
        """Start listening."""
        self._to = (host, port)
        self._listener = socket.create_server(("127.0.0.1", 0))
        self._sockets: list[socket.socket] = [self._listener]
        self.port: int = self._listener.getsockname()[1]
        threading.Thread(target=self._serve, daemon=True).start()

    def cut(self) -> None:
        """Close every connection and stop listening."""
        for sock in self._sockets:
            with suppress(OSError):
                sock.shutdown(socket.SHUT_RDWR)
            sock.close()

    def _serve(self) -> None:
        with suppress(OSError):
            while True:
                client, _ = self._listener.accept()
                self._sockets.append(client)
                there = socket.create_connection(self._to)
                self._sockets.append(there)
                for source, sink in ((client, there), (there, client)):
                    threading.Thread(target=_pump, args=(source, sink), daemon=True).start()


def _pump(source: socket.socket, sink: socket.socket) -> None:
    with suppress(OSError):
        while data := source.recv(_CHUNK):
            sink.sendall(data)
    for end in (source, sink):  # the end of one direction ends both
        with suppress(OSError):
            end.shutdown(socket.SHUT_RDWR)
