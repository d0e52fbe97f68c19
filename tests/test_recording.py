"""The Rerun recording: everything in it, also when it is made from the log alone."""

from __future__ import annotations

import subprocess
import sys

import pytest

import ffsm_mj
from ffsm_mj.recording import write_recording
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
