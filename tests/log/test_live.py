"""Streaming to an open viewer; a viewer that is missing, closes or hangs does not stop the run."""

from __future__ import annotations

import contextlib
import socket
import threading
import time
import warnings

import pytest
import rerun as rr

import ffsm_mj
from ffsm_mj.assembly.prepare import prepare
from ffsm_mj.cli.main import main
from ffsm_mj.log.rerun import sink as rerun_sink
from ffsm_mj.log.rerun import viewer as rerun_live
from ffsm_mj.log.rerun.viewer import viewer_command
from tests.log.test_recording import read
from tests.log.viewer_process import viewer_process
from tests.scenes import two_balls


def free_port():
    with socket.create_server(("127.0.0.1", 0)) as server:
        return server.getsockname()[1]


@contextlib.contextmanager
def stub_viewer(*, closes_after):
    """Viewer that accepts data and never answers; it closes after some connections, or never."""
    server = socket.create_server(("127.0.0.1", 0))
    held = []

    def serve():
        with contextlib.suppress(OSError):
            while True:
                held.append(server.accept()[0])
                if len(held) == closes_after:
                    break
        for each in (server, *held):
            each.close()

    thread = threading.Thread(target=serve)
    thread.start()
    yield server.getsockname()[1]
    with contextlib.suppress(OSError):
        server.shutdown(socket.SHUT_RDWR)
    server.close()
    thread.join()
    for each in held:
        each.close()


@pytest.mark.parametrize("overrides", [{}, {"realtime.factor": 20.0}], ids=["free", "in real time"])
def test_the_stream_equals_the_recording(tmp_path, caplog, overrides):
    port = free_port()
    received = tmp_path / "received.rrd"
    command = viewer_command("--port", str(port), "--save", str(received))
    with viewer_process(command):
        wait_for(port)
        run = ffsm_mj.run(two_balls(tmp_path), overrides, out=tmp_path / "out", live=f"127.0.0.1:{port}")
        time.sleep(0.5)
    assert run.outcome == "completed"
    assert not caplog.records
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # what the server saves has no footer
        recorded = read(tmp_path / "out" / "run.rrd")
        # The camera of a stream follows the base itself, as the path of the robot is not known in advance.
        assert read(received) == {key: rows for key, rows in recorded.items() if key[0] != "/world/followed"}


def wait_for(port):
    for _ in range(200):
        with contextlib.suppress(OSError):
            socket.create_connection(("127.0.0.1", port)).close()
            return
        time.sleep(0.1)
    raise TimeoutError(port)


def test_without_viewer_and_display_the_run_continues_with_one_warning(tmp_path, monkeypatch, capsys, caplog):
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setattr("sys.platform", "linux")
    address = f"127.0.0.1:{free_port()}"
    out = ["--out", str(tmp_path / "out"), "--no-rerun"]
    assert main(["run", str(two_balls(tmp_path)), "--live", "--viewer", address, *out]) == 0
    assert [record.message for record in caplog.records] == [
        f"no Rerun viewer at {address}, and none could be started (no display?); the run continues without it"
    ]
    assert "completed" in capsys.readouterr().out


@pytest.mark.parametrize("closes_after", [2, None], ids=["closes", "hangs"])
def test_a_viewer_that_closes_or_hangs_gives_one_warning(tmp_path, monkeypatch, caplog, closes_after):
    monkeypatch.setattr(rerun_live, "_PATIENCE_S", 0.3)
    monkeypatch.setattr(rerun_live, "_CHECK_PERIOD_S", 0.0)
    start = time.monotonic()
    with stub_viewer(closes_after=closes_after) as port:
        run = ffsm_mj.run(two_balls(tmp_path, duration_s=3.0), live=f"127.0.0.1:{port}")
    assert run.outcome == "completed"
    assert len(caplog.records) == 1
    assert "; the run continues without it" in caplog.text
    assert time.monotonic() - start < 10.0


def test_an_invalid_address_is_refused(tmp_path, capsys):
    arguments = ["run", str(two_balls(tmp_path)), "--live", "--viewer", "here", "--out", str(tmp_path / "out")]
    assert main(arguments) == 2
    assert capsys.readouterr().err == "here: not the address of a viewer; write host:port, e.g. 127.0.0.1:9876\n"


def test_each_run_is_a_recording_of_its_own_in_the_viewer(tmp_path, monkeypatch):
    """Also of runs that begin in the same second, as episodes do: a viewer would draw them over each other."""
    made = prepare(two_balls(tmp_path, duration_s=0.01))
    header, names, begin = made.run().log.header, [], rr.RecordingStream

    def noted(*args, recording_id, **options):
        names.append(recording_id)
        return begin(*args, recording_id=recording_id, **options)

    monkeypatch.setattr(rr, "RecordingStream", noted)
    monkeypatch.setattr(rerun_sink.RerunSink, "_connect", lambda _: None)
    for output in ("127.0.0.1:1", "127.0.0.1:1", lambda: tmp_path / "run.rrd"):
        rerun_sink.RerunSink(output, made.system, 50.0).open(header)
    assert len(set(names)) == 3
    assert names[2] == f"{header.scenario_name}-{header.metadata['created_utc']}"
