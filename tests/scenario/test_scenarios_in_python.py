"""Scenarios that a program builds: the same rows wherever they run, and faults that name the key."""

from __future__ import annotations

import copy
import pickle
import re
from multiprocessing import get_context
from pathlib import Path

import mujoco
import numpy as np
import pytest

import ffsm_mj
from ffsm_mj import Model, Robot, Scenario
from ffsm_mj.cli.main import main
from ffsm_mj.errors import InputError
from ffsm_mj.model.inline import InlineModel, inline_model
from tests.controllers.test_script_laws import Asks, Tuned
from tests.scenes import ball

TETRAHEDRON = "v 0 0 0\nv {0} 0 0\nv 0 {0} 0\nv 0 0 {0}\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n"
COAST = {"name": "coast", "until": "end", "controller": {"kind": "off"}}


def chaser():
    """A base with an arm of numbers that six digits do not hold, and a mesh among its assets."""
    spec = mujoco.MjSpec()
    spec.option.gravity = [0, 0, 0]
    spec.assets = {"hull.obj": TETRAHEDRON.format(1 / 3).encode()}
    spec.add_mesh(name="hull", file="hull.obj")
    base = spec.worldbody.add_body(name="base")
    base.add_freejoint(name="free")
    base.add_geom(name="hull", type=mujoco.mjtGeom.mjGEOM_MESH, meshname="hull", mass=100 / 3)
    arm = base.add_body(name="arm", pos=[1 / 7, 0, 0])
    arm.add_joint(name="shoulder", axis=[0, 0, 1])
    arm.add_geom(name="tip", type=mujoco.mjtGeom.mjGEOM_SPHERE, size=[0.1, 0, 0], pos=[2 / 3, 0, 0], mass=1 / 3)
    motor = spec.add_actuator(name="motor_2", target="shoulder")
    motor.trntype = mujoco.mjtTrn.mjTRN_JOINT
    return spec


def keys(**changes):
    """A sphere as text meets the tip of the arm at 0.1 s."""
    return {
        "name": "meeting",
        "duration_s": 0.2,
        "robot": Robot(model=chaser()),
        "objects": {"debris": Model(xml=ball("rock", mass=2 / 3))},
        "initial": {
            "joints": {"debris/free": np.array([1.1095238, 0.05, 0, 1, 0, 0, 0])},
            "rates": {"debris/free": [-1.0, 0, 0, 0, 0, 1 / 3]},
        },
        "contacts": {"rules": [{"between": ["robot/tip", "debris/rock"], "restitution": 0.5}]},
        "phases": [COAST],
    } | changes


def rows_of(scenario):
    return scenario.run().log.rows.tobytes()


@pytest.fixture(scope="module")
def scenario():
    return Scenario(**keys())


@pytest.fixture(scope="module")
def run(scenario):
    found = scenario.run()
    assert found.impacts
    assert all(check.passes for check in found.checks())
    return found


def test_the_documented_scenario_prints_what_the_page_promises(capsys):
    page = (Path(__file__).parents[2] / "docs" / "scenarios-in-python.md").read_text()
    (code,) = re.findall(r"```python\n(.*?)```", page, flags=re.DOTALL)
    exec(compile(code, "scenarios-in-python.md", "exec", dont_inherit=True), {})
    assert capsys.readouterr().out.splitlines() == re.findall(r"\)  # (.*)$", code, flags=re.MULTILINE)


def test_the_command_line_gives_the_same_rows_from_its_files(scenario, run, tmp_path):
    """In another folder than the current one, without what was in memory."""
    assert scenario.to_yaml(tmp_path / "files") == tmp_path / "files" / "scenario.yaml"
    written = {str(path.relative_to(tmp_path / "files")) for path in (tmp_path / "files").rglob("*.*")}
    assert written == {"scenario.yaml", "mjcf/robot/robot.xml", "mjcf/robot/hull.obj", "mjcf/debris/debris.xml"}
    assert main(["run", str(tmp_path / "files"), "--out", str(tmp_path / "out"), "--no-rerun"]) == 0
    assert ffsm_mj.load_run(tmp_path / "out").log.rows[:].tobytes() == run.log.rows.tobytes()
    with pytest.raises(InputError, match=r"files: already contains scenario\.yaml"):
        scenario.to_yaml(tmp_path / "files")


@pytest.mark.parametrize("name", ["coasting", "capture-planar", "air-bearing"])
def test_shipped_scenarios_give_the_same_rows_from_their_files(name, tmp_path):
    """With recorded files too."""
    shipped = Scenario.load(name, {"duration_s": 0.1})
    assert rows_of(Scenario.load(shipped.to_yaml(tmp_path))) == rows_of(shipped)


def test_its_run_folder_repeats_it_goes_on_and_is_analysed(scenario, run, tmp_path, capsys):
    assert scenario.run(tmp_path / "run", rerun=False).log.rows[:].tobytes() == run.log.rows.tobytes()
    assert rows_of(Scenario.load(tmp_path / "run")) == run.log.rows.tobytes()
    assert main(["analyze", str(tmp_path / "run")]) == 0
    later = ["run", str(tmp_path / "run"), "--from", "0.15", "--out", str(tmp_path / "later"), "--no-rerun"]
    assert main(later) == 0
    capsys.readouterr()
    again = ffsm_mj.load_run(tmp_path / "later").log.rows[:]
    assert again[-1].tobytes() == run.log.rows[-1].tobytes()


def test_another_process_gives_the_same_rows(scenario, run):
    """Before it is compiled and after, by a process that has nothing of this one."""
    fresh = Scenario(**keys())
    with get_context("spawn").Pool(1) as pool:
        for each in (fresh, scenario):
            assert pool.apply(rows_of, (each,)) == run.log.rows.tobytes()


def test_run_simulator_and_mappings_take_it(scenario, run):
    assert ffsm_mj.run(scenario).log.rows.tobytes() == run.log.rows.tobytes()
    assert ffsm_mj.run(keys()).log.rows.tobytes() == run.log.rows.tobytes()
    assert len(ffsm_mj.run(scenario, {"duration_s": 0.1}).time) == 101
    with ffsm_mj.Simulator(scenario) as simulator:
        simulator.reset()
        while not simulator.ended:
            simulator.step()
        assert simulator.close().log.rows.tobytes() == run.log.rows.tobytes()


@pytest.mark.long
def test_sweeps_and_campaigns_take_it(scenario, tmp_path):
    table = ffsm_mj.sweep(
        scenario, {"contacts.rules.0.restitution": np.array([0.2, 0.8])}, metrics=["impacts.0.impulse_N_s"], workers=1
    )
    low, high = table["impacts.0.impulse_N_s"].to_pylist()
    assert high / low == pytest.approx(1.8 / 1.2, rel=1e-9)
    stated = {
        "campaign": "mine",
        "scenario": scenario,
        "samples": {"kind": "grid"},
        "dispersions": {"contacts.rules.0.restitution": {"choice": [0.2, 0.8]}},
        "metrics": ["impacts.0.impulse_N_s"],
    }
    campaign = ffsm_mj.Campaign.load(stated, tmp_path / "mine")
    assert campaign.run(workers=2).done == 2
    assert campaign.table()["impacts.0.impulse_N_s"].to_pylist() == [low, high]
    assert ffsm_mj.Campaign.open(tmp_path / "mine").rerun(1).exact
    with pytest.raises(InputError, match=r"^dispersions\.contacts\.rules\.0\.restitutoin: "):
        ffsm_mj.Campaign.load(stated | {"dispersions": {"contacts.rules.0.restitutoin": {"choice": [0.2]}}}, tmp_path / "no")


def test_laws_of_its_own_belong_to_it(tmp_path):
    """By kind, or by the configuration of the law; they are asked for where a file names them."""
    phase = {"name": "settle", "until": "end", "controller": Tuned.Config(kind="tuned", gain=3.0)}
    mine = Scenario(**keys(phases=[phase]), controllers={"tuned": Gains})
    run = mine.run(tmp_path / "run", rerun=False)
    assert run["controller.damp_torque_N_m"].any()
    assert mine.phases[0].controller.gain == 3.0
    assert (
        Scenario.load(tmp_path / "run", controllers={"tuned": Gains}).run().log.rows.tobytes() == run.log.rows[:].tobytes()
    )
    with pytest.raises(
        InputError, match=r"phases\.0\.controller\.kind: the control law of kind 'tuned' was passed by a script"
    ):
        Scenario.load(tmp_path / "run")
    assert pickle.loads(pickle.dumps(mine)) == mine
    assert mine != Scenario(**keys(phases=[phase]), controllers={"tuned": Tuned})


class Gains(Tuned):
    """The same law of the shoulder."""

    def control(self, observation, command):
        self.torque = -self.gain * observation.data.qvel[6]
        command.drive([self.motor], self.torque)


def test_what_a_law_raises_carries_the_run_folder(tmp_path):
    phase = {"name": "ask", "until": "end", "controller": {"kind": "asks"}}
    with pytest.raises(KeyError, match="the models have no sensors") as caught:
        Scenario(**keys(phases=[phase]), controllers={"asks": Asks}).run(tmp_path / "run", rerun=False)
    assert ffsm_mj.load_run(caught.value.run_folder).outcome == "controller_failed"


def test_it_is_immutable_and_comparable(scenario):
    assert scenario == Scenario(**keys())
    assert scenario == copy.deepcopy(scenario) == pickle.loads(pickle.dumps(scenario))
    changed = scenario.with_overrides({"duration_s": 0.1, "contacts.rules.0.restitution": 0.25})
    assert (changed.duration_s, scenario.duration_s) == (0.1, 0.2)
    assert changed.contacts.rules[0].restitution == 0.25
    assert changed != scenario
    assert changed.with_overrides({"seed": 1}).duration_s == 0.1
    assert changed.with_overrides(["duration_s=0.2"]).with_overrides({"contacts.rules.0.restitution": 0.5}) == scenario
    assert scenario.model_copy(update={"duration_s": 0.1}).run().time[-1] == pytest.approx(0.1)
    with pytest.raises(ValueError, match="frozen"):
        scenario.duration_s = 1.0
    with pytest.raises(TypeError, match="unhashable"):
        hash(scenario)
    assert scenario != Scenario(**keys(objects={"debris": Model(xml=ball("rock", mass=0.7))}))


def test_paths_are_those_of_their_folder(tmp_path, monkeypatch):
    """In Python the current one; equal names in two folders are two models."""
    for name, mass in (("a", 1.0), ("b", 2.0)):
        (tmp_path / name).mkdir()
        (tmp_path / name / "ball.xml").write_text(ball(mass=mass))
        monkeypatch.chdir(tmp_path / name)
        made = Scenario(name="one", duration_s=0.01, robot=Robot(model=Path("ball.xml")), phases=[COAST])
        assert made.system.mj.body("robot/ball").mass == mass
        made.with_overrides({"description": "the same"}).to_yaml(tmp_path / name / "files")
    a, b = (Scenario.load(tmp_path / name / "files") for name in "ab")
    assert a != b
    assert a == Scenario.load(tmp_path / "a" / "files" / "scenario.yaml")


@pytest.mark.parametrize(
    ("changes", "fault"),
    [
        ({"duration_s": -1}, r"duration_s: should be greater than 0, got -1"),
        ({"dration_s": 1}, r"dration_s: unknown key \(did you mean 'duration_s'\?\)"),
        ({"phases": [COAST | {"controller": {"kind": "of"}}]}, r"phases\.0\.controller\.kind: unknown kind 'of' "),
        ({"robot": {"mjcf": "nowhere.xml"}}, r"robot\.mjcf: no such model file nowhere\.xml"),
        ({"robot": {}}, r"robot\.mjcf: is missing"),
        ({"robot": {"mjcf": 3}}, r"robot\.mjcf: must be a path, XML text or a mujoco.MjSpec, and is int, got 3"),
        ({"robot": {"mjcf": "a.xml", "xml": "<mujoco/>"}}, r"robot\.xml: unknown key"),
        ({"robot": {"xml": "<mujoco><worldbody>"}}, r"robot\.xml:1:20: malformed XML"),
        ({"robot": {"xml": ball().replace("</body>", "<geom mesh='m' type='mesh'/></body>")}}, r"robot\.xml: "),
        ({"objects": {"debris": {"xml": "<mujoco><include file='no.xml'/></mujoco>"}}}, r"debris\.xml:1: no\.xml: no such"),
        ({"contacts": {"rules": [{"between": ["robot/tip", "rack"]}]}}, r"contacts\.rules\.0\S*: unknown"),
        ({"extends": "baseline"}, r"extends: can only stand in a scenario file"),
    ],
)  # fmt: skip
def test_faults_name_the_key(changes, fault):
    """One line, without a file."""
    with pytest.raises(InputError, match=f"^{fault}") as caught:
        Scenario(**keys(**changes)).check()
    assert len(caught.value.lines) == 1


def test_overrides_are_values_of_a_file(scenario):
    """Arrays are; a model in memory is given where the scenario is built."""
    rates = np.array([0.0, 1.0, 0, 0, 0, 0])
    assert scenario.with_overrides({"initial.rates": {"debris/free": rates}}).initial.rates["debris/free"] == tuple(rates)
    with pytest.raises(InputError, match=r"^robot\.mjcf: .*InlineModel.*a value that a file can have"):
        scenario.with_overrides({"robot.mjcf": chaser()})
    with pytest.raises(InputError, match=r"robot\.xml:1:\d+: malformed XML"):
        Scenario(**keys(robot={"xml": "<mujoco>\ud800</mujoco>"})).check()


def test_a_simulator_raises_too_and_its_log_is_whole(tmp_path):
    """The step raises; leaving the simulator closes the log."""
    phase = {"name": "ask", "until": "end", "controller": {"kind": "asks"}}
    stated = keys(phases=[phase], controllers={"asks": Asks})
    with ffsm_mj.Simulator(stated, record=tmp_path / "run", rerun=False) as simulator:
        simulator.reset()
        with pytest.raises(KeyError, match="unknown sensor 'gyroo'") as caught:
            simulator.step()
    run = ffsm_mj.load_run(caught.value.run_folder)
    assert (run.outcome, run.complete) == ("controller_failed", True)
    with ffsm_mj.Simulator(stated, check=False) as simulator:
        simulator.reset()
        assert simulator.step().ended.outcome == "controller_failed"


@pytest.mark.long
def test_sweeps_take_the_laws_of_a_mapping():
    """In this process, where they cannot be imported by others."""
    phase = {"name": "settle", "until": "end", "controller": {"kind": "tuned", "gain": 1.0}}
    stated = keys(phases=[phase], controllers={"tuned": Gains})
    table = ffsm_mj.sweep(stated, {"phases.0.controller.gain": [1.0, 2.0]}, metrics=["outcome"], workers=1)
    assert table["outcome"].to_pylist() == ["completed"] * 2


def test_a_fault_of_an_override_names_it(scenario):
    with pytest.raises(InputError, match=r"^overrides: duration_s=-1: duration_s: should be greater than 0"):
        scenario.with_overrides({"duration_s": -1})
    with pytest.raises(
        InputError, match=r"^overrides: objects\.debris\.mjcf=\"no\.xml\": objects\.debris\.mjcf: no such model"
    ):
        scenario.with_overrides({"objects.debris.mjcf": "no.xml"}).check()


def test_a_specification_keeps_every_digit_and_is_not_changed():
    """Precision belongs to the process: it is as before, also for those who write XML themselves."""
    spec = chaser()
    before = spec.to_xml()
    system = Scenario(**keys(robot=Robot(model=spec))).system
    assert spec.to_xml() == before
    assert "0.333333333" not in before
    assert system.mj.body("robot/arm").mass == 1 / 3
    assert system.mj.body("robot/arm").pos[0] == 1 / 7
    np.testing.assert_allclose(system.mj.body("robot/base").inertia, spec.compile().body("base").inertia, rtol=1e-12)
    assert inline_model(spec) == inline_model(spec)


def test_files_of_a_specification_come_along(tmp_path):
    """From the folder of its file, and by absolute paths with equal names."""
    for name, size in (("a", 1.0), ("b", 2.0)):
        (tmp_path / name).mkdir()
        (tmp_path / name / "m.obj").write_text(TETRAHEDRON.format(size))
    mesh = '<compiler meshdir="a"/><asset><mesh name="m" file="m.obj"/></asset>'
    (tmp_path / "m.xml").write_text(
        ball(extra='<geom name="m" type="mesh" mesh="m"/>').replace("<worldbody>", f"{mesh}<worldbody>")
    )
    spec = mujoco.MjSpec.from_file(str(tmp_path / "m.xml"))
    other = spec.add_mesh(name="n", file=str(tmp_path / "b" / "m.obj"))
    spec.body("ball").add_geom(name="n", type=mujoco.mjtGeom.mjGEOM_MESH, meshname=other.name)
    kept = inline_model(spec)
    assert kept.assets == {
        each: (tmp_path / path).read_bytes() for each, path in (("m.obj", "a/m.obj"), ("2/m.obj", "b/m.obj"))
    }
    system = Scenario(**keys(robot=Robot(model=spec), objects={}, initial={}, contacts={})).system
    np.testing.assert_allclose(system.mj.mesh_vert, spec.compile().mesh_vert, rtol=1e-12)
    (tmp_path / "b" / "m.obj").unlink()
    with pytest.raises(InputError, match=r"^robot\.model: \S*/b/m\.obj: the specification uses this file, .*spec\.assets"):
        Scenario(**keys(robot={"model": spec}))


def test_what_xml_leaves_out_without_effect_is_no_loss():
    """A sphere has one size, whatever stands beside it."""
    spec = chaser()
    spec.geom("tip").size = [0.1, 0.7, 0.3]
    assert inline_model(spec) == inline_model(chaser())


def test_a_specification_that_its_xml_loses_is_refused(tmp_path):
    """Of attached models MuJoCo writes the names of files, not their folders: another mesh would be used."""
    for name, size in (("a", 1.0), ("b", 2.0)):
        (tmp_path / name).mkdir()
        (tmp_path / name / "m.obj").write_text(TETRAHEDRON.format(size))
        mesh = '<asset><mesh name="m" file="m.obj"/></asset>'
        geom = '<geom type="mesh" mesh="m" mass="1"/>'
        (tmp_path / name / "m.xml").write_text(
            f'<mujoco>{mesh}<worldbody><body name="{name}">{geom}</body></worldbody></mujoco>'
        )
    one, other = (mujoco.MjSpec.from_file(str(tmp_path / name / "m.xml")) for name in "ab")
    one.body("a").add_frame().attach_body(other.body("b"), "other_", "")
    with pytest.raises(InputError, match=r"the specification as XML is another model: \w+ differs"):
        inline_model(one)


def test_text_is_known_by_its_first_character():
    assert inline_model("\n  <mujoco/>") == InlineModel("\n  <mujoco/>")
    assert inline_model(Path("a.xml")) == inline_model("a.xml") == "a.xml"
    described = Scenario(**keys(description="<b>bold</b>"))
    assert described.description == "<b>bold</b>"
