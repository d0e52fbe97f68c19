"""Content of the Rerun recording, written by the run or made from the log."""

from __future__ import annotations

import subprocess
import sys
from collections import defaultdict

import mujoco
import numpy as np
import pytest
from rerun.chunk import RrdReader

import ffsm_mj
from ffsm_mj.log.drawing import Frames
from ffsm_mj.log.markers import PLUME_M, plume_series, thrusters
from ffsm_mj.log.rerun.plots import FIRING, Switching
from ffsm_mj.log.rerun.sink import write_recording
from ffsm_mj.records.signals import Layout, Signal, identifier
from tests.conftest import MJCF
from tests.scenes import compile_paths, two_balls

ENTITIES = (
    "/world/robot/ball",
    "/world/target/target",
    "/world/trails/robot",
    "/world/impacts/0",
    "/plots/energy",
    "/plots/balance",
    "/plots/linear_momentum/robot",
    "/states/phase",
    "/events",
)


def read(path):
    """Temporal data by entity and component: times in s and values, in order of time."""
    data = defaultdict(list)
    for chunk in RrdReader(path).stream():
        if chunk.is_static:
            continue
        assert chunk.timeline_names == ["sim_time"], chunk.entity_path
        batch = chunk.to_record_batch()
        times = np.asarray(batch.column("sim_time").cast("int64")) * 1e-9
        for name in batch.schema.names[2:]:
            data[chunk.entity_path, name] += zip(times, batch.column(name).to_pylist(), strict=True)
    return {key: sorted(rows, key=lambda row: row[0]) for key, rows in data.items()}


def entities(path, detail="-v"):
    """Entity paths in a recording, as listed by Rerun's own tool; with ``-vvv`` its whole content."""
    command = [sys.executable, "-m", "rerun", "rrd", "print", detail, str(path)]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    return done.stdout


@pytest.mark.long(one_of=2)
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


def test_a_plume_leaves_against_the_push():
    """Half as long at half the greatest force, and at half the scale; a thruster on a turned body turns with it."""
    system = compile_paths(MJCF / "ffsm_3dof_hardware.xml", {"object": MJCF / "box_1m.xml"})
    model = system.mj
    data = mujoco.MjData(model)
    data.qpos[2] = 0.7  # base yaw
    mujoco.mj_forward(model, data)
    names = [f"{identifier(name)}_{what}_N" for name in system.names("actuator") for what in ("applied", "lower", "upper")]
    layout = Layout(tuple(Signal("actuators", name, "N", "") for name in names if "jet" in name))
    jets = thrusters(system, layout)
    assert len(jets) == 8
    rows = np.tile([2.0, 0.0, 4.0], len(jets))[None]
    plume = plume_series(jets[0], Frames(np.zeros(1), rows, data.xpos[None].copy(), data.xquat[None].copy()), 0.5)
    actuator = system.names("actuator").index(jets[0].name)
    site = int(model.actuator_trnid[actuator, 0])
    np.testing.assert_allclose(plume.origins[0], data.site_xpos[site], atol=1e-12)
    data.ctrl[actuator] = 1.0
    mujoco.mj_forward(model, data)
    jacobian = np.empty((3, model.nv))
    mujoco.mj_jacSite(model, data, jacobian, None, site)
    push = np.linalg.lstsq(jacobian.T, data.qfrc_actuator, rcond=None)[0]
    np.testing.assert_allclose(plume.vectors[0], -0.5 * 0.5 * PLUME_M * push / np.linalg.norm(push), atol=1e-12)


def test_switching_is_detected_across_blocks():
    """A thruster that fires across a block boundary switches on once and off once."""
    rows = np.zeros((40, 2))
    rows[:, 0] = 0.1 * np.arange(40)
    rows[15:25, 1] = -3.0
    switching = Switching(0, {"jet": 1}, FIRING)
    found = [change for k in range(0, 40, 10) for change in switching.changes(rows[k : k + 10])]
    assert [(name, times.tolist(), states) for name, times, states in found] == [
        ("jet", [pytest.approx(1.5)], ["fires -"]),
        ("jet", [pytest.approx(2.5)], ["off"]),
    ]
