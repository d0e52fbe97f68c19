"""``ffsm new NAME --from RUN@TIME``: the state of a log as the start of a scenario, all digits; what a start cannot be."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import ffsm_mj
from ffsm_mj.cli.main import main
from tests.contact_models.grasp.scenes import grasping
from tests.controllers.test_phases import APPROACH, PAUSE, RETREAT, bouncing
from tests.servos.scenes import link_scene, playing
from tests.servos.test_inputs import PID, POSITION, SPEED


@pytest.fixture
def written(tmp_path, monkeypatch, capfd):
    """Writes the scenario ``start`` in a folder of its own, from a run; returns what was said."""
    (tmp_path / "here").mkdir()
    monkeypatch.chdir(tmp_path / "here")

    def write(text, code=0):
        assert main(["new", "start", "--from", text]) == code
        assert Path("start.yaml").exists() == (code == 0)
        said = capfd.readouterr()
        return said.err if code else said.out

    return write


def test_a_run_from_a_written_state_is_the_rest_of_the_logged_one(tmp_path, written):
    """Bit for bit while nothing else than the state counts: free motion, an impact, a capture; the times are others."""
    before = ffsm_mj.run(grasping(tmp_path / "scene"), out=tmp_path / "run", rerun=False)
    (grasp,) = before.grasps
    begins = int(np.searchsorted(before.time, 0.2995))
    said = written("../run@0.2995")
    assert f"begins at {before.time[begins]:g} s of ../run, in phase 'meet'; control laws" in said
    after = ffsm_mj.run("start.yaml", rerun=False)
    rest = slice(begins, begins + len(after.time))
    assert len(after.time) == len(before.time) - begins
    assert np.array_equal(after.qpos[0], before.qpos[begins])
    assert np.array_equal(after.qvel[0], before.qvel[begins])
    # Steps end at other times on the clock's grid: rounding of 1e-16, which the capture and the motion after it enlarge.
    np.testing.assert_allclose(after.qpos, before.qpos[rest], rtol=0.0, atol=1e-12)
    np.testing.assert_allclose(after.qvel, before.qvel[rest], rtol=0.0, atol=1e-12)
    assert after.grasps[0].time_s + before.time[begins] == pytest.approx(grasp.time_s, abs=1e-12)
    assert [phase.name for phase in after.phases] == ["meet", "hold", "leave"]


@pytest.mark.parametrize(
    ("actuator", "count"),
    [('<muscle name="servo" joint="j" lengthrange="-3 3" timeconst=".01 .04"/>', 1), (f'{PID[:-2]} slewmax="5"/>', 2)],
)
def test_activations_of_servos_are_part_of_the_state(tmp_path, written, actuator, count):
    """One or several; the law begins anew, here with the setpoint that it had: the rest of the motion is the same."""
    law = playing(tmp_path, 0.8 if count == 1 else {POSITION: 0.8, SPEED: 0.5})
    path = link_scene(tmp_path, law, actuators=actuator, duration_s=0.2)
    before = ffsm_mj.run(path, out=tmp_path / "run", rerun=False)
    written("../run@0.1")
    after = ffsm_mj.run("start.yaml", rerun=False)
    begins = len(before.time) - len(after.time)
    keys = [key for key in before.keys if "activation" in key]
    assert len(keys) == count
    for key in keys:
        assert after[key][0] == before[key][begins] != 0.0
        # Sub-steps begin with others than those of the long run: errors within what their control allows.
        np.testing.assert_allclose(after[key], before[key][begins:], rtol=0.0, atol=1e-9)
    np.testing.assert_allclose(after.qpos, before.qpos[begins:], rtol=0.0, atol=1e-9)


def test_the_phase_under_way_lasts_for_what_is_left_of_it(tmp_path, written):
    phases = [{"name": "all", "for_s": 0.5, "controller": {"kind": "off"}}, RETREAT]
    ffsm_mj.run(bouncing(tmp_path, phases), out=tmp_path / "run", rerun=False)
    written("../run@0.2")
    assert "  - {name: all, for_s: 0.3}\n  - {name: retreat}\n" in Path("start.yaml").read_text()
    ffsm_mj.run("start.yaml", out="again", rerun=False)
    Path("start.yaml").rename("first.yaml")
    # A run that begins so has a start like any other; one by 'initial.from' too.
    written("again@0.1")
    assert "for_s: 0.2" in Path("start.yaml").read_text()
    Path("start.yaml").rename("second.yaml")
    ffsm_mj.resume(tmp_path / "run", 0.1, out="resumed", rerun=False)
    written("resumed@0.2")
    assert "  from: null\n  at_s: null\n" in Path("start.yaml").read_text()
    assert ffsm_mj.run("start.yaml", rerun=False).time[-1] == pytest.approx(0.8)


def test_what_a_start_cannot_be_is_refused_in_a_line(tmp_path, written):
    ffsm_mj.run(grasping(tmp_path / "grasp"), out=tmp_path / "grasped", rerun=False)
    (tmp_path / "branch").mkdir()
    ffsm_mj.run(bouncing(tmp_path / "branch", [APPROACH, PAUSE, RETREAT]), out=tmp_path / "branched", rerun=False)
    orbit = {"environment": {"orbit": {"altitude_km": 500}}, "duration_s": 0.1}
    ffsm_mj.run(grasping(tmp_path / "grasp"), orbit, out=tmp_path / "orbiting", rerun=False)
    for text, said in (
        ("../grasped@1.5", "new: --from: 1.5 s: grasp 'grasp' is closed, which no start can have; take an instant before"),
        ("../branched@0.35", "new: --from: 0.35 s: phase 'pause' of phases that branch is not the first one"),
        ("../grasped@2.5", "new: --from: 2.5 s is not an instant after the start of the run, which lasts from 0 to 2 s"),
        ("../orbiting@0.05", "new: --from: 0.05 s: with an orbit a start is at t = 0 of it; 'initial: {from"),
        ("../none@1", "new: --from: ../none is no run folder that can go on: it has no scenario.yaml"),
        ("../grasped", "ffsm new: argument --from: ../grasped is not RUN@TIME, such as logs/cap@50"),
        ("../grasped@", "ffsm new: argument --from: ../grasped@ is not RUN@TIME, such as logs/cap@50"),
        ("../grasped@0", "ffsm new: argument --from: 0 is not a positive number"),
    ):
        assert written(text, 2).startswith(said)
    assert main(["new", "start", "--from", "../grasped@0.1", "--wheels", "4"]) == 2
