"""What a log says against what its states say: every changed number shows, and nothing else does."""

from __future__ import annotations

from dataclasses import fields, replace

import numpy as np
import pytest

import ffsm_mj
from ffsm_mj.analysis.run_models import all_checks
from ffsm_mj.records.events import ImpactRecord
from ffsm_mj.replay import replay_log
from ffsm_mj.yaml import plain_value, write_yaml
from tests.changed_logs import with_records
from tests.contact_models.grasp.scenes import grasping
from tests.scenes import ball, two_balls

CHANGE = 1e-8
"""Planted in a log. What agrees is told apart to 1e-10 (1 + scale), and all scales here are below 5."""


@pytest.fixture(scope="module")
def hit(tmp_path_factory, ffsm_run):
    """2 kg at 1 m/s on 3 kg after 30 ms, held by a motor on its torque-speed line before, braked after; 81 samples."""
    phases = [
        {"name": "go", "until": "impact", "controller": {"kind": "pd", "joints": ["robot/x"], "kp": 0.5, "kd": 0.1}},
        {"name": "brake", "until": "end", "controller": {"kind": "pd", "joints": ["robot/x"], "kp": 0.5, "kd": 2.0}},
    ]
    motor = {"robot/push_x": {"kind": "torque_speed", "stall_torque_N_m": 0.45, "no_load_speed_rad_s": 5.0}}
    folder = tmp_path_factory.mktemp("hit")
    run = ffsm_run(two_balls(folder, gap=0.03, duration_s=0.08, phases=phases, actuators=motor, restitution=0.7))
    assert len(run.impacts) == 1
    return run


def changed(run, key, line, by=CHANGE):
    """The log with one number of one sample changed."""
    rows = run.log.rows.copy()
    rows[line, run.keys.index(key)] += by
    return replace(run.log, rows=rows)


def driven(folder, **scenario):
    """A motor brakes the first ball with 5 N; once that goes backwards its torque-speed line allows 2.5 N."""
    check = {"kind": "pd", "joints": ["robot/x"], "kp": 5.0, "kd": 0.0, "target": [-1.0]}
    motor = {"robot/push_x": {"kind": "torque_speed", "stall_torque_N_m": 3.0, "no_load_speed_rad_s": 1.1}}
    phases = [{"name": "push", "until": "end", "controller": check}]
    return two_balls(folder, **{"gap": 0.0305, "duration_s": 0.1, "phases": phases, "actuators": motor, **scenario})


SCENES = {
    "two balls": lambda folder: (two_balls(folder, restitution=0.5), {}),
    "plastic": lambda folder: (two_balls(folder, restitution=0.0), {}),
    "stopped at the impact": lambda folder: (two_balls(folder, gap=0.3005, stop_on_impact=True), {}),
    "stopped by the number of impacts": lambda folder: (two_balls(folder, impact={"max_impacts": 1}), {}),
    "driven": lambda folder: (driven(folder), {}),
    "driven, hit in the last tick": lambda folder: (driven(folder, duration_s=0.031), {}),
    "driven, stopped at the impact": lambda folder: (driven(folder, stop_on_impact=True), {}),
    "driven, stopped by the number of impacts": lambda folder: (driven(folder, impact={"max_impacts": 1}), {}),
    "several steps a tick": lambda folder: (two_balls(folder, time_step_s=0.001, control_period_s=0.02), {}),
    "baseline with its impact": lambda _: ("coasting", {"time_step_s": 0.002, "control_period_s": 0.01}),
    "spatial": lambda _: ("spatial", {"duration_s": 3.0}),
    "thrusters and a wheel": lambda _: ("free-flying-hardware", {"duration_s": 1.0}),
    "thrusters, steps in a tick": lambda _: ("free-flying-hardware", {"duration_s": 1.0, "control_period_s": 0.004}),
    "pushed base": lambda _: ("free-flying", {"duration_s": 1.0}),
}


@pytest.mark.long
@pytest.mark.parametrize("scene", SCENES)
def test_a_log_as_it_was_written_agrees(tmp_path, scene):
    """On the machine that wrote it every number is found again to a few units in the last place: 1e-14 (1 + scale)."""
    run = ffsm_mj.run(*SCENES[scene](tmp_path))
    rows = []
    again = replay_log(run.log, rows=rows.append)
    assert (again.obstacle, again.gaps) == ("", "")
    assert again.samples == len(run.time)
    assert again.agrees
    assert max(worst.excess for worst in again.worst.values()) < 1e-14 / 1e-10
    np.testing.assert_allclose(np.concatenate(rows), run.log.rows, rtol=1e-12, atol=1e-12)


STATES = ("state.q_robot_x_m", "state.q_target_x_m", "state.v_robot_x_m_s", "state.v_target_x_m_s", "state.time_s")
EFFORTS = (
    *(f"actuators.robot_push_x_{what}_N" for what in ("command", "applied", "lower", "upper")),
    *(f"actuators.target_push_x_{what}_N" for what in ("command", "applied")),  # of an object, which no law may drive
)


@pytest.mark.long
@pytest.mark.parametrize("line", [0, 15, 30, 31, 79, 80])
@pytest.mark.parametrize("key", STATES + EFFORTS)
def test_a_changed_state_or_effort_shows(hit, key, line):
    """At the first and last sample too, around the impact (between 30 and 31), and where no flight follows."""
    if line == 80 and key.endswith("command_N"):
        pytest.skip("what a controller asked for last acts no more and follows from nothing else")
    again = replay_log(changed(hit, key, line))
    assert not again.agrees
    worst = max(again.worst.values(), key=lambda one: one.excess)
    if line:  # the balance of the whole run begin with the first state
        assert worst.time_s == pytest.approx(hit.time[line], abs=0.0011)


@pytest.mark.long
@pytest.mark.parametrize("eighth", range(8))
def test_every_column_that_follows_from_states_shows_a_change_and_names_itself(hit, eighth):
    followed = [key for key in hit.keys if key.split(".")[0] in ("energy", "momentum", "balance")]
    assert len(followed) >= 64
    for key in followed[eighth::8]:
        again = replay_log(changed(hit, key, 45))
        assert not again.agrees
        worst = again.worst["columns"]
        assert (worst.what, worst.time_s) == (key, hit.time[45])
        assert worst.size == pytest.approx(CHANGE, rel=1e-6)
        assert again.worst["motion"].passes


@pytest.mark.long
@pytest.mark.parametrize("field", [each.name for each in fields(ImpactRecord)])
def test_every_field_of_an_impact_shows_a_change(hit, field):
    (record,) = hit.impacts

    def other(value):
        if isinstance(value, str):
            return value + "x"
        if isinstance(value, int):
            return value + 1
        if isinstance(value, tuple) and isinstance(value[0], str):
            return (other(value[0]), *value[1:])
        if isinstance(value, tuple):
            # What acts after it is known by the step that follows: 1e-6 N for 0.5 ms on 2 kg are 2.5e-10 m/s.
            return (value[0] + (1e-6 if field == "efforts_after" else CHANGE), *value[1:])
        return value + CHANGE

    given = getattr(record, field)
    wrong = {name: other(value) for name, value in given.items()} if isinstance(given, dict) else other(given)
    again = replay_log(with_records(hit.log, {"impacts": (replace(record, **{field: wrong}),)}))
    assert not again.agrees


def test_pairs_that_another_run_has_closed_are_a_difference(tmp_path):
    """A ball leaves the other one, which leaves no pair closed: names in the log meet an empty list, and are no numbers."""
    law = {"kind": "pd", "joints": ["robot/x"], "kp": 5.0, "kd": 0.0}
    phases = [
        {"name": "push", "for_s": 0.02, "controller": law | {"target": [1.0]}},
        {"name": "pull", "until": "end", "controller": law | {"target": [-1.0]}},
    ]
    run = ffsm_mj.run(two_balls(tmp_path, gap=0.0, speed=0.0, restitution=0.0, duration_s=0.04, phases=phases))
    (begins,), (ends,) = run.records["contact_beginnings"], run.records["contact_endings"]
    assert (len(begins.closed_pairs), ends.closed_pairs) == (1, ())
    log = with_records(run.log, {"contact_endings": (replace(ends, closed_pairs=begins.closed_pairs),)})
    worst = replay_log(log).worst["impacts"]
    assert (worst.what, worst.size) == ("contact_ends 1 closed_pairs", np.inf)
    log = with_records(run.log, {"contact_beginnings": (replace(begins, closed_pairs=()),)})
    assert replay_log(log).worst["impacts"].what == "contact_begins 1 closed_pairs"


def test_a_quaternion_and_its_negative_are_one_rotation(tmp_path):
    """Attitudes with the other sign in some rows and events: the motion is the same. One that is turned shows."""
    near = {
        "joints": {"target/free": [1.12, 0.03, 0.02, 1, 0, 0, 0]},
        "rates": {"target/free": [-0.3, 0, 0, 0.4, -0.2, 0.3], "shoulder": 0.1},
    }
    run = ffsm_mj.run(grasping(tmp_path, duration_s=0.6, initial=near))
    (caught,) = run.grasps
    columns = [run.keys.index(f"state.q_target_free_q{part}") for part in "wxyz"]

    def other(sign, by=0.0):
        rows = run.log.rows.copy()
        rows[50:200, columns] *= sign
        rows[300:500, columns] *= sign  # the object is held
        rows[400, columns] += by * np.array((-rows[400, columns[1]], rows[400, columns[0]], 0.0, 0.0))
        quaternion = slice(len(run.impacts[0].qpos) - 4, None)
        records = {}
        for name, events in run.log.records.items():
            if not events or not hasattr(events[0], "qpos"):
                continue
            turned = [np.array(each.qpos) for each in events]
            for qpos in turned:
                qpos[quaternion] *= sign
            records[name] = tuple(replace(a, qpos=tuple(b.tolist())) for a, b in zip(events, turned, strict=True))
        return replay_log(with_records(replace(run.log, rows=rows), records))

    assert 0.2 < caught.time_s < 0.3
    again = other(-1.0)
    assert again.agrees, again.worst
    assert not other(-1.0, CHANGE).agrees


def test_an_impact_that_is_missing_or_made_up_shows(hit):
    (record,) = hit.impacts
    assert not replay_log(with_records(hit.log, {"impacts": ()})).agrees
    twice = (record, replace(record, event=1, time_s=0.05, step=50))
    assert not replay_log(with_records(hit.log, {"impacts": twice})).agrees


def test_a_mass_that_was_not_the_runs_shows(hit):
    files = {name: text.replace(b'mass="2.0"', b'mass="2.1"') for name, text in hit.log.header.files.items()}
    again = replay_log(replace(hit.log, header=replace(hit.log.header, files=files)))
    assert not again.agrees


def test_a_mass_that_the_scenario_did_not_give_shows(hit):
    data = plain_value(hit.log.header.scenario_yaml) | {"model": {"robot": {"ball": {"mass_kg": 2.1}}}}
    again = replay_log(replace(hit.log, header=replace(hit.log.header, scenario=write_yaml(data))))
    assert again.obstacle == ""
    assert not again.agrees


def test_books_are_recomputed_and_not_believed(hit):
    """A log that says that energy was conserved while its states lose it: its own numbers hold, theirs do not."""
    rows, keys = hit.log.rows.copy(), list(hit.keys)
    rows[40:, keys.index("state.v_target_x_m_s")] *= 0.99
    again = replay_log(replace(hit.log, rows=rows))
    assert all(check.passes for check in all_checks(ffsm_mj.analysis.run.Run(replace(hit.log, rows=rows))))
    assert "energy" in {check.name for check in again.checks() if not check.passes}
    assert not again.agrees


GAPS = {
    "dropped": (lambda i: i[(i < 30) | (i >= 40)], "samples are missing from 0.029 to 0.04 s"),
    "dropped at the start": (lambda i: i[5:], "samples are missing from 0 to 0.005 s"),
    "dropped at the end": (lambda i: i[:-5], "samples are missing from 0.075 to 0.08 s"),
    "twice": (lambda i: np.insert(i, 10, 9), "the sample at 0.009 s occurs twice"),
    "a stretch twice": (lambda i: np.r_[i[:20], i[10:]], "the sample at 0.01 s follows the one at 0.019 s"),
    "swapped": (lambda i: np.r_[i[:10], i[20:30], i[10:20], i[30:]], "the sample at 0.01 s follows the one at 0.029 s"),
}


@pytest.mark.parametrize("kind", GAPS)
def test_samples_follow_each_other_by_the_control_period(hit, kind):
    """What is missing, twice or in another order is told with its place; what is left agrees, and its checks pass."""
    choose, words = GAPS[kind]
    log = replace(hit.log, rows=hit.log.rows[choose(np.arange(81))])
    again = replay_log(log)
    assert words in again.gaps
    assert again.agrees
    assert all(check.passes for check in again.checks())


def test_without_models_nothing_is_claimed(hit):
    again = replay_log(replace(hit.log, header=replace(hit.log.header, files={})))
    assert again.obstacle
    assert not again.agrees
    assert (again.samples, again.worst) == (0, {})


@pytest.mark.long
def test_states_that_are_no_numbers_end_nothing(hit):
    for value in (np.nan, np.inf, 1e300):
        for key in STATES + EFFORTS:
            again = replay_log(changed(hit, key, 50, by=value))
            assert not again.agrees
    rows = []
    replay_log(changed(hit, "state.q_robot_x_m", 50, by=np.nan), rows=rows.append)
    again = np.concatenate(rows)
    assert np.isnan(again[50]).all()
    np.testing.assert_allclose(again[51:], hit.log.rows[51:], rtol=1e-12, atol=1e-12)  # the balance go on as they were


def test_control_laws_of_others_need_not_be_there(hit):
    text = hit.log.header.scenario_yaml.replace("kind: pd", "kind: someones_own")
    assert text != hit.log.header.scenario_yaml
    assert replay_log(replace(hit.log, header=replace(hit.log.header, scenario=text))).agrees


def test_where_models_are_not_conservative_the_way_is_flown_all_the_same(tmp_path):
    """Damping: the integration repeats itself."""
    slow = ball("ball", mass=2.0, joints="x").replace('axis="1 0 0"/>', 'axis="1 0 0" damping="0.5"/>')
    path = two_balls(tmp_path, conservative=False, gap=0.9)
    (tmp_path / "robot.xml").write_text(slow)
    run = ffsm_mj.run(path)
    assert run["state.v_robot_x_m_s"].min() < 0.9
    assert replay_log(run.log).agrees


def test_a_scenario_that_makes_no_run_is_an_obstacle(hit):
    text = hit.log.header.scenario_yaml
    for wrong in (
        text.replace("time_step_s: 0.001", "time_step_s: 9.0"),
        text.replace("time_step_s:", "step_s:"),
        "[]",
        "{",
    ):
        assert wrong != text
        again = replay_log(replace(hit.log, header=replace(hit.log.header, scenario=wrong)))
        assert again.obstacle
        assert not again.agrees


def test_an_overlap_shows_in_the_states_whatever_the_log_says_of_it(hit):
    """The target is moved into the ball by 1e-8 m: the column still says that nothing overlapped."""
    rows, keys = hit.log.rows.copy(), list(hit.keys)
    robot, target = (keys.index(f"state.q_{name}_x_m") for name in ("robot", "target"))
    rows[60:, target] = rows[60:, robot] + 0.2 - 1e-8
    log = replace(hit.log, rows=rows)
    (told,) = (check for check in all_checks(ffsm_mj.analysis.run.Run(log)) if check.name == "no penetration")
    (found,) = (check for check in replay_log(log).checks() if check.name == "no penetration")
    assert told.passes
    assert not found.passes
    assert found.residual == pytest.approx(1e-8, rel=1e-6)
