"""The viewer accepts data from this machine only, unless a flag is given."""

from __future__ import annotations

import subprocess
import sys
import time
from pathlib import Path

import pytest

from ffsm_mj.cli.main import main
from ffsm_mj.log.rerun import viewer as rerun_live
from ffsm_mj.log.rerun.viewer import viewer_command
from tests.log.test_live import free_port, wait_for
from tests.log.viewer_process import viewer_process
from tests.scenes import two_balls

HERE, EVERYWHERE = "0100007F", "00000000"  # IPv4 addresses as /proc/net/tcp writes them


def listeners(port: int) -> set[str]:
    """Addresses on which this machine listens on a port."""
    found = set()
    for table in ("/proc/net/tcp", "/proc/net/tcp6"):
        for line in Path(table).read_text().splitlines()[1:]:
            address, number = line.split()[1].split(":")
            if int(number, 16) == port and line.split()[3] == "0A":
                found.add(address)
    return found


TABLE = pytest.mark.skipif(not Path("/proc/net/tcp").exists(), reason="no table of sockets")


@pytest.mark.long(one_of=2)
@TABLE
@pytest.mark.parametrize(("options", "expected"), [({}, HERE), ({"listen": "0.0.0.0"}, EVERYWHERE)])
def test_the_socket_of_the_viewer(options, expected):
    port = free_port()
    command = viewer_command("--port", str(port), "--serve-grpc", **options)
    with viewer_process(command):
        wait_for(port)
        assert listeners(port) == {expected}
    deadline = time.monotonic() + 30.0
    while listeners(port):  # a port that stays open would be reachable after the tests
        assert time.monotonic() < deadline
        time.sleep(0.05)


@pytest.fixture
def called(monkeypatch) -> list[list[str]]:
    """Command lines of the viewers that would be opened, on a machine with a display."""
    commands: list[list[str]] = []
    monkeypatch.setenv("DISPLAY", ":0")
    monkeypatch.setattr(subprocess, "call", lambda command: commands.append(command) or 0)
    return commands


@pytest.mark.parametrize(
    ("given", "address"), [([], "127.0.0.1"), (["--listen", "0.0.0.0"], "0.0.0.0"), (["--listen", "::1"], "::1")]
)
@pytest.mark.parametrize("record", [True, False])
def test_view_passes_the_address_to_listen_on(tmp_path, called, capsys, given, address, record):
    out = ["--out", str(tmp_path / "out"), *([] if record else ["--no-rerun"])]
    assert main(["run", str(two_balls(tmp_path, duration_s=0.01)), *out]) == 0
    assert main(["view", str(tmp_path / "out"), *given]) == 0
    (command,) = called
    assert command[:5] == [sys.executable, "-m", "rerun", "--bind", address]
    assert Path(command[5]).name == "run.rrd"
    assert Path(command[5]).is_absolute()
    capsys.readouterr()


def test_an_invalid_address_is_refused(called, capsys):
    assert main(["view", "--listen", "everywhere"]) == 2
    assert "everywhere is not an IP address" in capsys.readouterr().err
    assert called == []


def test_a_viewer_opened_by_a_live_run_listens_locally(tmp_path, monkeypatch, caplog):
    commands: list[list[str]] = []

    class Dead:
        def __init__(self, command: list[str], **_: object) -> None:
            commands.append(command)

        def poll(self) -> int:
            return 1

    monkeypatch.setenv("DISPLAY", ":0")
    monkeypatch.setattr(rerun_live.subprocess, "Popen", Dead)
    port = free_port()
    live = ["--live", "--viewer", f"127.0.0.1:{port}", "--out", str(tmp_path / "out")]
    assert main(["run", str(two_balls(tmp_path, duration_s=0.01)), *live]) == 0
    (command,) = commands
    assert command[1:7] == ["-m", "rerun", "--bind", "127.0.0.1", "--port", str(port)]
    assert len(caplog.records) == 1


@TABLE
def test_the_relay_of_a_live_run_listens_locally():
    from ffsm_mj.log.rerun.viewer import Relay

    relay = Relay("127.0.0.1", free_port())
    try:
        assert listeners(relay.port) == {HERE}
    finally:
        relay.cut()
