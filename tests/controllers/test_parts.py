"""Several control laws in one phase: each drives its own actuators, and together they do what one law does."""

from __future__ import annotations

import re
from typing import ClassVar

import numpy as np
import pytest

import ffsm_mj
from ffsm_mj.assembly.prepare import prepare
from ffsm_mj.controller_protocol import Signal, driven_joints
from ffsm_mj.errors import InputError
from tests.controllers.test_track import ARM, GAINS, WHEELS, following, scene

BASE = {"thrusters": ["thruster_x", "thruster_y"], "wheels": ["wheel"]}
BASE |= {"translation": {"kp": 50.0, "kd": 37.5}, "rotation": {"kp": 200.0, "kd": 150.0}}
HOLD = {"kp": 150.0, "kd": 112.5}
MOVING = {
    "duration_s": 0.2,
    "initial.rates.base_x": 0.1,
    "initial.rates.base_yaw": -0.05,
    "initial.rates.joint_2": 0.2,
}


def phase(**laws):
    return {"phases": [{"name": "all", "until": "end", **laws}]}


def planar(**laws):
    """The planar robot of the case study on the move, with one phase."""
    return ffsm_mj.run("free-flying", MOVING | phase(**laws))


def alike(run, other):
    """Whether all columns that two runs share are equal to the bit, apart from the laws' own."""
    keys = [signal.key for signal in run.log.header.layout.signals if signal.group != "controller"]
    return all(np.array_equal(run[key], other[key], equal_nan=True) for key in keys)


def test_base_and_arm_are_one_free_flying_law_to_the_bit():
    one = planar(controller={"kind": "free_flying", **BASE, "arm": HOLD})
    two = planar(controllers={"base": {"kind": "base_pd", **BASE}, "arm": {"kind": "pd", **HOLD}})
    assert alike(one, two)
    for name in ("base_position_error_m", "base_rotation_error_rad"):
        np.testing.assert_array_equal(one[f"controller.{name}"], two[f"controller.base_{name}"])
    (record,) = two.phases
    assert record.controller == "base: base_pd, arm: pd"
    assert np.ptp(two["actuators.robot_motor_2_applied_N_m"]) > 0.0
    assert np.ptp(two["actuators.robot_wheel_applied_N_m"]) > 0.0


@pytest.mark.parametrize("order", [("base", "arm"), ("arm", "base")])
def test_a_tracking_arm_knows_what_the_base_does(order):
    """A law that comes after the others is told their efforts: the same torques as of one law for both."""
    gains = {"kp_N_m_rad": 8.0, "kd_N_m_s_rad": 30.0}
    one = ffsm_mj.run("capture", scene(following(base={"wheels": WHEELS, "rotation": gains}), duration_s=0.3))
    parts = {
        "arm": following(),
        "base": {"kind": "base_pd", "wheels": WHEELS, "rotation": {"kp": 8.0, "kd": 30.0}},
    }
    changes = scene(None, duration_s=0.3) | phase(controllers={name: parts[name] for name in order})
    two = ffsm_mj.run("capture", changes)
    assert alike(one, two)
    np.testing.assert_array_equal(one["controller.track_error_m"], two["controller.arm_track_error_m"])
    reports = two.summary()["controller"]["phases"][0]["reports"]
    assert reports["arm_least_share"] == 1.0
    assert reports["arm_near_singularity_s"] == 0.0


def test_the_riccati_law_is_the_same_as_a_part():
    """Rows, columns of its own and statistics of the Riccati equation."""
    law = {"kind": "osdre", "Q": [1.0, 1.0, 0.5, 0.5], "R": [1.0, 1.0, 1.0]}
    one, two = planar(controller=law), planar(controllers={"arm": law, "base": {"kind": "base_pd"}})
    assert alike(one, two)
    for name in ("osdre_error_m", "osdre_riccati_residual", "osdre_riccati_fallback", "osdre_smallest_gain"):
        np.testing.assert_array_equal(one[f"controller.{name}"], two[f"controller.arm_{name}"])
    alone, part = (run.summary()["controller"]["phases"][0]["reports"] for run in (one, two))
    assert {f"arm_{name}": value for name, value in alone.items()} == part
    assert alone["worst_riccati_residual"] > 0.0


def test_parts_live_on_while_an_object_is_grasped():
    """Both laws are made again for the grasped system, in one law and in two."""
    near = {"position_m": 10.0, "angle_rad": 4.0, "speed_m_s": 10.0, "rate_rad_s": 10.0}
    grasp = {"robot_site": "tip", "object_site": "satellite/grapple", "when": {"within": near}}
    gains = {"wheels": WHEELS, "rotation": {"kp": 8.0, "kd": 30.0}}
    arm = {"joints": ARM, "kp": 40.0, "kd": 50.0}

    def run(**laws):
        changes = scene(None, duration_s=0.1, grasps={"grasp": grasp})
        return ffsm_mj.run("capture", changes | {"phases": [{"name": "all", "until": "end", "arm": ["grasp"], **laws}]})

    one = run(controller={"kind": "free_flying", **gains, "arm": arm})
    two = run(controllers={"base": {"kind": "base_pd", **gains}, "arm": {"kind": "pd", **arm}})
    assert len(two.grasps) == 1
    assert alike(one, two)


def written(tmp_path, parts):
    path = tmp_path / "mine.yaml"
    lines = "\n".join(f"      {name}: {law}" for name, law in parts.items())
    path.write_text(
        "extends: free-flying\nname: mine\nduration_s: 0.01\nphases:\n"
        f"  - name: safety_pause\n    until: end\n    for_s: null\n    controllers:\n{lines}\n"
    )
    return path


def test_an_actuator_of_two_parts_is_refused_with_both_lines(tmp_path):
    parts = {"arm": "{kind: pd, kp: 1.0, kd: 1.0, joints: [joint_1, joint_2]}"}
    parts["wrist"] = "{kind: pd, kp: 1.0, kd: 1.0, joints: [joint_2, joint_3]}"
    path = written(tmp_path, parts)
    with pytest.raises(InputError) as refused:
        prepare(path)
    first, second = refused.value.lines
    said = "drives robot/motor_2, and so does the part"
    assert first == f"{path}:9:7: phases.0.controllers.arm: {said} 'wrist'; each actuator has one part"
    assert second == f"{path}:10:7: phases.0.controllers.wrist: {said} 'arm'; each actuator has one part"


def test_joints_that_are_left_out_are_those_of_no_other_part(tmp_path):
    parts = {"rest": "{kind: pd, kp: 1.0, kd: 1.0}", "wrist": "{kind: pd, kp: 1.0, kd: 1.0, joints: [joint_3]}"}
    (phase,) = prepare(written(tmp_path, parts)).assemble().controller.phases
    rest, wrist = phase.controller.parts
    assert (rest.name, rest.law.driven_actuators.tolist()) == ("rest", [3, 4])
    assert (wrist.name, wrist.law.driven_actuators.tolist()) == ("wrist", [5])
    with pytest.raises(InputError, match=r"controllers\.two\.joints: no joint is left to drive"):
        prepare(written(tmp_path, {"one": parts["rest"], "two": parts["rest"]}))
    # The same in a section of a law.
    gains = "{kp: 1.0, kd: 1.0}"
    more = {"free": f"{{kind: free_flying, arm: {gains}}}", "wrist": parts["wrist"]}
    (phase,) = prepare(written(tmp_path, more)).assemble().controller.phases
    assert phase.controller.parts[0].law.driven_actuators.tolist() == [3, 4]


def test_check_says_what_no_part_drives(tmp_path):
    lines = prepare(written(tmp_path, {"arm": "{kind: pd, kp: 1.0, kd: 1.0, joints: [joint_1]}"})).describe()
    assert "  phases: safety_pause (arm: pd)" in lines
    names = "robot/thruster_x, robot/thruster_y, robot/wheel, robot/motor_2, robot/motor_3"
    assert f"note: no part of phase 'safety_pause' drives {names}" in lines
    single = {"phases": [{"name": "a", "until": "end", "controller": {"kind": "pd", "joints": ["joint_1"], **HOLD}}]}
    lines = prepare("free-flying", single).describe()
    assert "note: nothing drives robot/motor_2, robot/motor_3 in phase 'a' (pd): these joints move freely" in lines
    assert not any("drives" in line for line in prepare("coasting").describe())


def test_damping_of_all_parts_counts_together(tmp_path):
    """Each part alone is stable at this period, both together are not: the eigenvalue is that of one law for all joints."""
    parts = {f"j{i}": f"{{kind: pd, kp: 0.0, kd: {kd}, joints: [joint_{i}]}}" for i, kd in ((1, 390.0), (2, 350.0))}

    def told(**laws):
        notes = prepare(written(tmp_path, laws), {"control_period_s": 0.01}).describe()
        return [re.findall(r"eigenvalue ([\d.]+)", note)[0] for note in notes if "unstable" in note]

    assert [told(**{name: law}) for name, law in parts.items()] == [[], []]
    (eigenvalue,) = told(**parts)
    assert told(arm="{kind: pd, kp: 0.0, kd: [390.0, 350.0], joints: [joint_1, joint_2]}") == [eigenvalue]


class Push:
    """A law that says nothing of its actuators, as one from outside may."""

    telemetry_signals: ClassVar = (Signal("controller", "pushes", "", "calls of the law"),)

    def __init__(self, config, context):
        self.motor, self.calls = driven_joints(context.system, [self.joint]).actuators, 0

    def start(self, observation): ...

    def control(self, observation, command):
        assert not command.powered.any()
        self.calls += 1
        command.drive(self.motor, np.array([0.25]))

    def telemetry(self):
        return (float(self.calls),)

    def summary(self):
        return {"calls": self.calls}


class First(Push):
    joint = "joint_1"


class Second(Push):
    joint = "joint_2"


def outside(*, check=True, **kinds):
    laws = {"duration_s": 0.01, **phase(controllers={name: {"kind": kind} for name, kind in kinds.items()})}
    return ffsm_mj.run("free-flying", laws, controllers={"first": First, "second": Second}, check=check)


def test_laws_from_outside_are_parts_as_they_are():
    run = outside(one="first", two="second")
    assert run.outcome == "completed", run.message
    for i in (1, 2):
        np.testing.assert_array_equal(run[f"actuators.robot_motor_{i}_command_N_m"][:-1], 0.25)
    assert not run["actuators.robot_motor_3_command_N_m"].any()
    np.testing.assert_array_equal(run["controller.one_pushes"], run["controller.two_pushes"])
    reports = run.summary()["controller"]["phases"][0]["reports"]
    assert reports == {"one_calls": 10, "two_calls": 10}


def test_laws_from_outside_that_drive_the_same_end_the_run():
    run = outside(one="first", two="first", check=False)
    assert run.outcome == "controller_failed"
    expected = "phase 'all', part 'two' (first) at t = 0 s: it drives robot/motor_1, which part 'one' (first) drives too"
    assert run.message == expected


def test_check_says_which_parts_are_not_known():
    laws = phase(controllers={"one": {"kind": "first"}, "rest": {"kind": "pd", "joints": ["joint_2", "joint_3"], **HOLD}})
    lines = prepare("free-flying", laws, controllers={"first": First}).describe()
    assert any("part 'one' (first) of phase 'all' does not state which actuators it drives" in line for line in lines)
    names = "robot/thruster_x, robot/thruster_y, robot/wheel, robot/motor_1"
    assert f"note: only part 'one' of phase 'all' may drive {names}" in lines


class Odd(First):
    driven_actuators = (0, 99)

    def start_faults(self, data):
        raise RuntimeError("no licence")


def test_what_a_law_from_outside_states_is_not_trusted():
    def refused(law):
        laws = phase(controllers={"one": {"kind": "odd"}, "two": {"kind": "off"}})
        with pytest.raises(InputError) as error:
            prepare("free-flying", laws, controllers={"odd": law}).assemble()
        (line,) = error.value.lines
        return line.partition("controllers.one.")[2]

    assert refused(Odd) == "kind: driven_actuators of kind 'odd' contains 99; ids are 0 to 5"
    text = type("Text", (Odd,), {"driven_actuators": ("motor_1",)})
    assert refused(text).startswith("kind: the controller cannot be made (ValueError: invalid literal for int()")
    right = type("Right", (Odd,), {"driven_actuators": (3,)})
    assert refused(right) == "kind: whether the controller can begin cannot be computed (RuntimeError: no licence)"


class Asks(First):
    """Asks for a release in its second call."""

    def control(self, observation, command):
        super().control(observation, command)
        if self.calls == 2:
            command.requests.add("nobody.release")


def test_requests_of_parts_are_heard():
    laws = phase(controllers={"one": {"kind": "asks"}, "two": {"kind": "second"}})
    run = ffsm_mj.run("free-flying", {"duration_s": 0.01, **laws}, controllers={"asks": Asks, "second": Second}, check=False)
    assert run.outcome == "controller_failed"
    assert "at t = 0.001 s: unknown request 'nobody.release'" in run.message


@pytest.mark.parametrize(
    ("parts", "said"),
    [
        ("{arm: {kind: pd, kp: 1.0, kd: 1.0, kpp: 2}}", r"arm\.kpp: unknown key.*allowed: joints, kd, kind, kp"),
        ("{arm: {kind: pdd}}", r"controllers\.arm\.kind: unknown kind 'pdd' \(did you mean 'pd'\?\)"),
        ("{arm: {}}", r"controllers\.arm: needs a 'kind'"),
        ("{}", r"controllers: should have at least 1 item"),
        ("{the arm: {kind: 'off'}}", r"controllers\.the arm: must be written like"),
        ("{arm: {kind: pd, kp: 1.0, kd: 1.0, joints: [elbow]}}", r"arm\.joints\.0: unknown joint of the robot"),
        ("null", r"phases\.0: a phase needs 'controller"),
    ],
)  # fmt: skip
def test_faults_of_parts_in_one_line(tmp_path, parts, said):
    path = tmp_path / "mine.yaml"
    text = f"    controllers: {parts}\n"
    path.write_text(f"extends: free-flying\nname: mine\nphases:\n  - name: only\n    until: end\n{text}")
    with pytest.raises(InputError, match=said) as refused:
        prepare(path)
    assert len(refused.value.lines) == 1


def test_parts_replace_an_inherited_law_and_the_other_way_round(tmp_path):
    path = written(tmp_path, {"arm": "{kind: pd, kp: 1.0, kd: 1.0}"})  # the parent's phase has one controller
    (first,) = prepare(path).scenario.phases
    assert first.controller is None
    child = tmp_path / "child.yaml"
    child.write_text("extends: mine.yaml\nname: child\nphases: [{name: safety_pause, controller: {kind: 'off'}}]\n")
    (second,) = prepare(child).scenario.phases
    assert (second.controllers, second.kind) == (None, "off")
    for override, kind in {"controller={kind: 'off'}": "off", "controller.kind='off'": "off"}.items():
        (third,) = prepare(path, [f"phases.0.{override}"]).scenario.phases
        assert (third.controllers, third.kind) == (None, kind)
    (fourth,) = prepare(child, ["phases.safety_pause.controllers.arm={kind: pd, kp: 1.0, kd: 1.0}"]).scenario.phases
    assert (fourth.controller, fourth.kind) == (None, "arm: pd")
    both = "{name: only, until: end, controller: {kind: 'off'}, controllers: {arm: {kind: 'off'}}}"
    with pytest.raises(InputError, match="has both 'controller' and 'controllers'"):
        prepare(path, [f"phases=[{both}]"])


def test_a_run_folder_with_parts_runs_again(tmp_path):
    path = written(tmp_path, {"arm": "{kind: pd, kp: 1.0, kd: 1.0, joints: [joint_1]}", "base": "{kind: base_pd}"})
    run = ffsm_mj.run(path, out=tmp_path / "run")
    again = ffsm_mj.run(tmp_path / "run" / "scenario.yaml")
    np.testing.assert_array_equal(run.log.rows, again.log.rows)


def test_fingers_are_left_alone_by_the_law_of_the_arm():
    """Without joints the law that tracks takes those that move its site: neither wheels nor what hangs on another branch."""
    law = {key: value for key, value in following().items() if key != "joints"}
    (phase,) = prepare("capture", scene(law)).assemble().controller.phases
    system = prepare("capture").system
    driven = [system.names("actuator")[i] for i in phase.controller.driven_actuators]
    assert driven == [f"robot/{name}" for name in ARM]
    two = phase_of(law, {"kind": "pd", "joints": ["hand_roll"], **HOLD})
    assert [len(part.law.driven_actuators) for part in two.parts] == [6, 1]
    assert GAINS["kp_1_s2"] > 0.0


def phase_of(arm, hand):
    changes = scene(None) | phase(controllers={"arm": arm, "hand": hand})
    return prepare("capture", changes).assemble().controller.phases[0].controller
