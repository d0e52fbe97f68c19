"""What goes wrong: fields that fail, orbits in several threads, logs that end in the midst."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading
import time
from typing import Literal

import numpy as np
import pytest

import ffsm_mj
from ffsm_mj.fields.interface import Field, StrictModel
from ffsm_mj.fields.orbit import Orbit
from ffsm_mj.replay import replay_log
from tests.fields.test_going_on import OBLATE, pressed
from tests.fields.test_orbit import EYE
from tests.scenes import ball, scene


class Failing(Field):
    """Fails from a time on."""

    kind = "failing"

    class Config(StrictModel):
        """Keys of the field."""

        kind: Literal["failing"]
        force_N: str = ""

    def __init__(self, config, bodies):
        self._force = config.force_N

    def add_wrenches(self, time_s, bodies):
        if time_s > 0.3:
            if not self._force:
                raise RuntimeError("no table for this time")
            bodies.force_N[0, 1] += float(self._force)


@pytest.mark.parametrize(
    ("force", "error", "words"),
    [
        ("", RuntimeError, "no table for this time"),
        (
            "nan",
            ValueError,
            r"external field 'failing': force \[ 0. nan  0.\] N, torque .* on 'robot/ball' at t = 0.3",
        ),
        ("inf", ValueError, r"external field 'failing': force \[ 0. inf  0.\] N"),
    ],
)
def test_a_field_that_fails_ends_the_run_by_name(tmp_path, force, error, words):
    """And leaves a log up to there, whose replay agrees."""
    keys = {"kind": "failing", "force_N": force}
    path = scene(tmp_path, ball(), {}, environment={"fields": [keys]}, duration_s=0.5)
    with pytest.raises(error, match=words):
        ffsm_mj.run(path, fields=[Failing], out=tmp_path / "run", rerun=False)
    run = ffsm_mj.load_run(tmp_path / "run")
    assert run.outcome == "internal_error"
    assert run.time[-1] == pytest.approx(0.3, abs=2e-3)
    again = replay_log(run.log)
    assert again.agrees, again.worst


def test_a_motion_that_diverges_is_no_fault_of_a_field(tmp_path):
    path = scene(tmp_path, ball(), {}, environment={"fields": [{"kind": "failing", "force_N": "1e300"}]}, duration_s=0.5)
    assert ffsm_mj.run(path, fields=[Failing]).outcome == "diverged"


def around(folder, duration_s=60.0):
    """A ball 30 m from the origin of an orbit under J2."""
    initial = {"joints": {"free": [30.0, 0, 5.0, *EYE]}}
    steps = {"duration_s": duration_s, "time_step_s": 0.5, "control_period_s": 0.5}
    return scene(folder, ball(), {}, environment={"orbit": OBLATE}, initial=initial, **steps)


def test_runs_in_threads_share_the_pieces_of_an_orbit(tmp_path):
    """Pieces under J2 are made as they are asked for: those of two threads were in the list twice, 10 km off."""
    path, ends = around(tmp_path), []
    usual_s = sys.getswitchinterval()
    alone = ffsm_mj.run(path).qpos[-1]
    Orbit.of.cache_clear()
    sys.setswitchinterval(1e-6)
    try:
        threads = [threading.Thread(target=lambda: ends.append(ffsm_mj.run(path).qpos[-1])) for _ in range(4)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
    finally:
        sys.setswitchinterval(usual_s)
    assert len(ends) == 4
    assert all(np.array_equal(end, alone) for end in ends)


@pytest.mark.long
def test_a_run_that_is_killed_leaves_a_log_that_replays(tmp_path):
    path, out = around(tmp_path, 1e5), tmp_path / "run"
    code = f"import ffsm_mj; ffsm_mj.run({str(path)!r}, out={str(out)!r}, rerun=False)"
    process = subprocess.Popen([sys.executable, "-c", code])
    deadline = time.monotonic() + 30.0
    while not any(file.stat().st_size > 100_000 for file in out.glob("*")) and time.monotonic() < deadline:
        time.sleep(0.02)
    os.kill(process.pid, signal.SIGKILL)
    process.wait()
    run = ffsm_mj.load_run(out)
    assert run.time[-1] > 10.0
    again = replay_log(run.log)
    assert again.agrees, again.worst


def test_a_damaged_log_agrees_where_it_can_be_read(tmp_path):
    """A stretch of zeros in the midst: what is behind it is replayed from there, at its own time."""
    ffsm_mj.run(pressed(tmp_path), out=tmp_path / "run", rerun=False)
    file = tmp_path / "run" / "run.mcap"
    data = bytearray(file.read_bytes())
    middle = len(data) // 2
    data[middle : middle + 64] = bytes(64)
    file.write_bytes(data)
    run = ffsm_mj.load_run(tmp_path / "run")
    assert run.log.damage
    again = replay_log(run.log)
    assert again.agrees, again.worst
