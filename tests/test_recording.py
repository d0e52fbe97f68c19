"""The Rerun recording: everything in it, also when it is made from the log alone."""

from __future__ import annotations

import os
import socket
import subprocess
import sys
import time

import mujoco
import numpy as np
import pytest

import ffsm_mj
from ffsm_mj.log import live_viewer
from ffsm_mj.log.drawing import Frames
from ffsm_mj.log.rerun_plumes import Switching, plume_vectors
from ffsm_mj.model import compile_system
from ffsm_mj.recording import write_recording
from ffsm_mj.runner import prepare
from tests.conftest import MJCF
from tests.scenes import two_balls

ENTITIES = (
    "/world/robot/ball",
    "/world/target/target",
    "/world/trails/robot",
    "/world/impacts/0",
    "/plots/energy",
    "/plots/ledger",
    "/plots/linear_momentum/robot",
    "/states/phase",
    "/events",
)


def entities(path):
    """Entity paths in a recording, as Rerun's own tool lists them."""
    command = [sys.executable, "-m", "rerun", "rrd", "print", "-v", str(path)]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    return done.stdout


@pytest.mark.parametrize("source", ["run", "log"])
def test_a_recording_holds_scene_plots_phases_and_events(tmp_path, source):
    path = two_balls(tmp_path)
    run = ffsm_mj.run(path, out=tmp_path / "out", rerun=source == "run")
    recording = tmp_path / "out" / "run.rrd"
    if source == "log":
        assert not recording.exists()
        write_recording(ffsm_mj.load_run(tmp_path / "out" / "run.mcap").log, recording)
    text = entities(recording)
    for entity in ENTITIES:
        assert entity in text
    assert run.outcome == "completed"


@pytest.fixture
def listening_viewer():
    """Rerun's server without a window, as a viewer would listen."""
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    command = [sys.executable, "-m", "rerun", "--serve-grpc", "--port", str(port)]
    server = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    until = time.monotonic() + 30.0
    while not live_viewer._listens(port):
        assert time.monotonic() < until, "the server does not listen"
        time.sleep(0.05)
    yield server, port
    server.kill()
    server.wait()


def test_a_run_streams_to_a_viewer_and_outlives_it(tmp_path, listening_viewer):
    """The viewer goes away in the middle: the run ends as it would, and its log is whole."""
    server, port = listening_viewer
    path = two_balls(tmp_path, duration_s=3.0)

    def close_viewer(time_s, _duration_s):
        if time_s >= 1.0 and server.poll() is None:
            server.kill()
            server.wait()

    run = prepare(path).run(out=tmp_path / "out", viewer=live_viewer.find_viewer(port), report=close_viewer)
    assert server.poll() is not None
    assert run.outcome == "completed"
    assert ffsm_mj.load_run(tmp_path / "out").time[-1] == pytest.approx(3.0)


@pytest.mark.skipif(live_viewer._listens(live_viewer.PORT), reason="a viewer is open on this machine")
def test_live_without_display_or_viewer_says_so_and_runs(tmp_path):
    path = two_balls(tmp_path, duration_s=0.5)
    environment = {k: v for k, v in os.environ.items() if k not in ("DISPLAY", "WAYLAND_DISPLAY")}
    command = [sys.executable, "-m", "ffsm_mj.cli", "run", str(path), "--live", "--out", str(tmp_path / "out")]
    done = subprocess.run(command, env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == 0
    (line,) = [line for line in done.stderr.splitlines() if "--live" in line]
    assert "no display" in line
    assert "goes on without it" in line


def test_arrow_and_plume_data():
    """A plume leaves against the push; a thruster on a turned body turns with it."""
    system = compile_system(MJCF / "ffsm_3dof_hardware.xml", {"object": MJCF / "box_1m.xml"}, time_step_s=1e-3)
    model = system.mj
    data = mujoco.MjData(model)
    data.qpos[2] = 0.7  # base yaw
    mujoco.mj_forward(model, data)
    actuator = next(i for i in range(model.nu) if model.actuator_trntype[i] == mujoco.mjtTrn.mjTRN_SITE)
    site = int(model.actuator_trnid[actuator, 0])
    frames = Frames(np.zeros((1, 1)), data.xpos[None].copy(), data.xquat[None].copy())
    origins, vectors = plume_vectors(system, actuator, frames, np.array([2.0]), full=4.0)
    np.testing.assert_allclose(origins[0], data.site_xpos[site], atol=1e-12)
    data.ctrl[actuator] = 1.0
    mujoco.mj_forward(model, data)
    jacobian = np.empty((3, model.nv))
    mujoco.mj_jacSite(model, data, jacobian, None, site)
    push = np.linalg.lstsq(jacobian.T, data.qfrc_actuator, rcond=None)[0]
    assert vectors[0] @ push == pytest.approx(-np.linalg.norm(vectors[0]) * np.linalg.norm(push), rel=1e-9)


def test_switching_is_followed_across_blocks():
    """A thruster that fires from one block into the next switches on once and off once."""
    rows = np.zeros((40, 2))
    rows[:, 0] = 0.1 * np.arange(40)
    rows[15:25, 1] = -3.0
    switching = Switching({"jet": 1})
    found = [change for k in range(0, 40, 10) for change in switching.changes(rows[k : k + 10])]
    assert [(name, times.tolist(), states) for name, times, states in found] == [
        ("jet", [pytest.approx(1.5)], ["fires -"]),
        ("jet", [pytest.approx(2.5)], ["off"]),
    ]
