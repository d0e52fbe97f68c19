"""Steps cut by ``accuracy``: checks pass whatever the step of the grid, and a log is replayed with the same sub-steps."""

from __future__ import annotations

import json
import math

import numpy as np
import pytest

import ffsm_mj
from ffsm_mj.analysis.run_models import all_checks
from ffsm_mj.balance.step_error import StepError
from ffsm_mj.errors import InputError
from ffsm_mj.replay import replay_log
from tests.contact_models.grasp.scenes import OFF, grasping
from tests.contact_models.limits import DRIVEN, driven_by
from tests.contact_models.persistent.random_pushes import LAWS, drawn
from tests.replays import assert_passes, assert_replayed
from tests.scenes import ARM, HEAD, box, scene


def whirling(folder, *, rate=1.0, **scenario):
    """An arm that whirls at up to 10 rad/s on a tumbling base, before a tumbling box: 10 ms are far too long for it."""
    rates = {
        "shoulder": 4.0 * rate,
        "elbow": -7.0 * rate,
        "robot/free": [0.2, 0, 0, *(rate * np.array((1.0, 2.0, 3.0)))],
        "b/free": [-2.0, 0, 0, *(rate * np.array((3.0, 6.0, 2.0)))],
    }
    return scene(
        folder,
        ARM,
        {"b": box("b", half=(0.1, 0.2, 0.35))},
        **{
            "duration_s": 0.3,
            "time_step_s": 0.01,
            "control_period_s": 0.02,
            "initial": {"joints": {"shoulder": 0.3, "elbow": 0.9, "b/free": [3, 0.3, 0.2, 1, 0, 0, 0]}, "rates": rates},
            "contacts": {"rules": [{"between": ["tip", "b/b"]}]},
            **scenario,
        },
    )


@pytest.fixture(scope="module")
def accurate(tmp_path_factory):
    return ffsm_mj.run(whirling(tmp_path_factory.mktemp("whirling"), accuracy=1e-9))


def test_a_run_passes_its_checks_whatever_its_step(tmp_path, accurate):
    fixed = ffsm_mj.run(whirling(tmp_path))
    assert max(check.residual / check.tolerance for check in all_checks(fixed)) > 100.0
    # A step may use up 0.5 of a hundred thousandth of the tolerance; its rounding, and that of what is compared, as much.
    assert max(check.residual / check.tolerance for check in all_checks(accurate)) < 30 / 100_000


def test_a_log_is_replayed_with_the_same_sub_steps(accurate):
    again = replay_log(accurate.log)
    assert again.agrees
    assert again.worst["motion"].size == 0.0


MARBLE = """<mujoco><option gravity="0 0 -10"/><worldbody><body name="marble"><freejoint name="free"/>
  <inertial pos="0 0 0" mass="1" diaginertia=".3 .4 .45"/><geom name="marble" type="sphere" size="0.5" mass="0"/>
  <site name="jet"/></body></worldbody><actuator><motor name="jet" site="jet" gear="1 0 0 0 0 0"/></actuator></mujoco>"""
HILL = '<mujoco><option gravity="0 0 -10"/><worldbody><geom name="hill" type="sphere" size="2"/></worldbody></mujoco>'


@pytest.mark.parametrize(("accuracy", "step_s"), [(1e-6, 0.01), (1e-5, 0.02)])
def test_an_event_at_the_end_of_a_sub_step_begins_no_other_one(tmp_path, accuracy, step_s):
    """A marble rolls over a hill; commands arrive half a step late, where a sub-step ends.

    What rounding of the time leaves to the event is no sub-step: that would project out a slip of 1e-12 m/s that the run
    has. A replay that knows the rest of a step from the logged time makes the steps of the run bit by bit.
    """
    path = scene(
        tmp_path,
        MARBLE,
        {"hill": HILL},
        fixed={"hill": {"position_m": [0, 0, -2]}},
        conservative=False,
        initial={"joints": {"free": [0, 0, 0.5, 1, 0, 0, 0]}, "rates": {"robot/free": [2, 1, 0, -2, 4, 8]}},
        contacts={"rules": [{"between": ["robot", "hill"], "restitution": 0.0, "mu": 1.0}]},
        duration_s=0.1,
        time_step_s=step_s,
        control_period_s=step_s,
        accuracy=accuracy,
        actuation={"delay_s": 0.5 * step_s},
        phases=DRIVEN,
    )
    run = ffsm_mj.run(path, controllers=driven_by(lambda time_s: math.sin(40.0 * time_s)))
    assert len(run.log.records["effort_changes"]) == round(0.1 / step_s)
    again = replay_log(run.log)
    assert again.agrees
    assert again.worst["motion"].size == 0.0
    assert again.worst["impacts"].size < 1e-13  # of speeds of 10 m/s and rad/s


def test_a_step_is_whole_after_an_event_at_its_start(tmp_path):
    """Arming at a tick takes nothing off the step: a replay divides the rest as the run does, bit by bit."""
    near = {"within": {"position_m": 1e-6}}
    grasps = {name: {"robot_site": "grip", "object_site": "handle", "when": near} for name in "abcd"}
    phases = [{"name": name, "for_s": 0.03, "arm": [name], "controller": OFF} for name in "abc"]
    phases.append({"name": "d", "until": "end", "arm": ["d"], "controller": OFF})
    rates = {"robot/free": [0, 0, 0, 2, -3, 4], "target/free": [-0.3, 0, 0, 4, -2, 3], "shoulder": 3.0, "elbow": -4.0}
    path = grasping(
        tmp_path,
        grasps=grasps,
        phases=phases,
        initial={"joints": {"target/free": [3, 0, 0, 1, 0, 0, 0]}, "rates": rates},
        duration_s=0.2,
        time_step_s=0.01,
        control_period_s=0.01,
        accuracy=1e-9,
    )
    run = ffsm_mj.run(path)
    assert [each.time_s for each in run.records["armings"]] == pytest.approx([0.0, 0.03, 0.06, 0.09])
    again = replay_log(run.log)
    assert again.agrees
    assert again.worst["motion"].size == 0.0


def test_the_work_is_told(accurate):
    summary = accurate.summary()
    assert summary["steps"] == 30
    assert summary["sub_steps"] > 10 * summary["steps"]
    assert 0.01 / 1024 <= summary["smallest_step_s"] < 0.01 / 10


def test_the_answer_is_that_of_a_shorter_step(tmp_path, accurate):
    short = ffsm_mj.run(whirling(tmp_path, time_step_s=0.0001))
    # Errors of 1e-14 of energy a step of 1e-2 s, and of as little of the state in 30 of them; 1e-4 s leaves some 1e-11.
    np.testing.assert_allclose(accurate.qpos[-1], short.qpos[-1], rtol=0.0, atol=1e-9)


@pytest.mark.long
@pytest.mark.parametrize("seed", [1, 2, 13])
def test_under_pressing_contacts_and_across_events(tmp_path, seed):
    """Scenes with impacts and persistent contact of bodies that spin, some of which fail at a fixed step."""
    rng = np.random.default_rng(seed)
    path = drawn(rng, tmp_path, step=5e-3, steps=20)
    said = json.loads(path.read_text())
    said["initial"]["rates"]["block/free"][3:] = (4.0 * rng.normal(size=3)).tolist()
    path.write_text(json.dumps(said | {"accuracy": 1e-9}))
    run = ffsm_mj.run(path, controllers=LAWS)
    again = replay_log(run.log)
    assert_passes(run)
    assert again.agrees
    assert all(check.passes for check in again.checks())


@pytest.mark.long
@pytest.mark.parametrize(
    ("scenario", "period_s"),
    # At 20 ms one pulse of the 50 N thrusters exceeds the momentum that is left: they would fire at every tick.
    [("capture-planar", 0.02), ("free-flying-hardware", 0.02), ("free-flying", 0.005)],
)
def test_while_an_object_is_grasped_and_with_thrusters_and_ideal_motors(scenario, period_s):
    overrides = {"accuracy": 1e-9, "duration_s": 14.0, "time_step_s": period_s, "control_period_s": period_s}
    run = ffsm_mj.run(scenario, overrides)
    again = replay_log(run.log)
    assert_passes(run)
    assert again.agrees
    assert run.summary()["sub_steps"] > run.summary()["steps"]


def test_a_motion_too_fast_for_any_step_ends_the_run(tmp_path):
    """At 1e5 rad/s the shortest sub-step, 10 us, is one radian: no accuracy, an outcome of its own, and no stall."""
    run = ffsm_mj.run(whirling(tmp_path, rate=1e5, accuracy=1e-9))
    assert run.outcome == "step_limit"
    assert "shorter time_step_s or a larger accuracy, or mend an unstable control law" in run.message
    assert_replayed(run)


def test_what_a_shorter_step_does_not_mend_is_left_to_the_checks(tmp_path, monkeypatch):
    """A leak at a rate of 1e-3 of all energy a second: no sub-step is too short for it, the run goes on and fails."""
    honest = StepError.relative
    monkeypatch.setattr(StepError, "relative", lambda self, t, *a, **k: honest(self, t, *a, **k) + 1e-3 * t)
    run = ffsm_mj.run(whirling(tmp_path, rate=0.1, accuracy=1e-9))
    assert run.outcome == "completed"
    assert run.summary()["sub_steps"] == run.summary()["steps"]


def test_rounding_of_short_steps_does_not_make_a_step_long(tmp_path, monkeypatch):
    """With rounding of 1e-12 in each sub-step, above the share of any: its own truncation would be 1e-6 in a whole step."""
    honest = StepError.relative
    monkeypatch.setattr(StepError, "relative", lambda self, t, *a, **k: honest(self, t, *a, **k) + 1e-12)
    run = ffsm_mj.run(whirling(tmp_path, accuracy=1e-9, duration_s=0.1))
    assert_passes(run)


@pytest.mark.parametrize(("value", "said"), [("1e-12", "greater than or equal"), ("1", "less than"), ("yes", "number")])
def test_an_accuracy_that_is_none_is_refused(tmp_path, value, said):
    path = whirling(tmp_path)
    with pytest.raises(InputError, match=said):
        ffsm_mj.run(path, [f"accuracy={value}"])


def test_without_conservation_there_is_nothing_to_measure_by(tmp_path):
    robot = ARM.replace(HEAD, '<option gravity="0 0 0" density="1"/>', 1)
    path = scene(tmp_path, robot, {}, accuracy=1e-9, conservative=False)
    with pytest.raises(InputError, match=r"accuracy: nothing is conserved"):
        ffsm_mj.run(path)
