"""Whole runs with grasps: at a touch, within bounds, released, taken again, hit while held; and their logs."""

from __future__ import annotations

import dataclasses
import json
import math

import numpy as np
import pytest

import ffsm_mj
from ffsm_mj.analysis.run_models import all_checks
from ffsm_mj.assembly.prepare import prepare
from ffsm_mj.cli.main import main
from ffsm_mj.errors import InputError
from ffsm_mj.experiments.metrics import fault_of, metric_values
from ffsm_mj.replay import replay_log
from ffsm_mj.report.run_report import run_report
from ffsm_mj.verification.truncation import ExplainedChecks
from tests.changed_logs import with_records
from tests.contact_models.grasp.scenes import BOUNDS, FLAT_TARGET, NEAR, OFF, TARGET, TOUCH, grasping, stone
from tests.laws import Law
from tests.replays import proved
from tests.scenes import ball, scene

HOLD = {"kind": "pd", "kp": 2.0, "kd": 1.0, "target": [0.5, -0.4]}


def test_taken_at_a_touch_held_and_let_go(tmp_path):
    """At the instant of the impact, resolved first; velocities of the object while held are those of the hand's frame."""
    out = tmp_path / "run"
    run = proved(ffsm_mj.run(grasping(tmp_path / "scene"), out=out))
    (impact,), (capture,), (release,) = (run.records[name] for name in ("impacts", "grasp_impulses", "releases"))
    assert (capture.time_s, capture.step) == (impact.time_s, impact.step)
    assert capture.qvel_before == impact.qvel_after
    assert release.time_s == pytest.approx(1.804, abs=1e-12)
    assert [(phase.name, phase.reason) for phase in run.phases] == [
        ("meet", "start"),
        ("hold", "grasp"),
        ("leave", "time"),
    ]
    energy = capture.energy_before_J["total"][0]
    assert abs(capture.energy_change_J + capture.loss_J) <= 1e-14 * energy
    assert capture.rank == 6
    # Velocities are continuous at the release, and the object flies on alone.
    assert release.qvel_before == release.qvel_after
    grasp, times = run["contact.grasp_closed"], run.time
    np.testing.assert_array_equal(grasp == 1.0, (times > capture.time_s) & (times <= release.time_s))
    force = np.column_stack([run[f"contact.grasp_force_{x}_N"] for x in "xyz"])
    assert np.all((np.abs(force).max(axis=1) > 0.0) == (grasp == 1.0))
    (told,) = run.grasps
    assert (told.grasp, told.time_s, told.release_s) == ("grasp", capture.time_s, release.time_s)
    at_events = run["contact.grasp_event_force_N"]
    highest = max(np.linalg.norm(force[times < release.time_s], axis=1).max(), at_events.max())
    assert told.peak_force_N == pytest.approx(highest, rel=1e-14)
    assert run["contact.grasp_event_s"][np.flatnonzero(at_events)].tolist() == [capture.time_s]
    summary = json.loads((out / "summary.json").read_text())
    assert summary["grasps"] == [{**dataclasses.asdict(told), "impulse": list(told.impulse)}]
    assert ffsm_mj.load_run(out).grasps == run.grasps
    assert run.table("grasps").columns["impulse_x"].tolist() == [told.impulse[0]]


@pytest.mark.long(one_of=3)
@pytest.mark.parametrize("step_s", [1e-3, 2e-3, 4e-3])
def test_bounds_are_met_at_a_root_not_at_a_tick(tmp_path, step_s):
    """The instant does not depend on the step, and the largest value is its bound there."""
    run = proved(ffsm_mj.run(grasping(tmp_path, BOUNDS, time_step_s=step_s, control_period_s=4e-3, duration_s=1.2)))
    (capture,) = run.records["grasp_impulses"]
    values = capture.position_m / 0.1, capture.angle_rad / 0.5, capture.speed_m_s, capture.rate_rad_s
    assert max(values) == pytest.approx(1.0, abs=1e-11)
    assert max(values) <= 1.0
    reference = tmp_path / "reference"
    run = ffsm_mj.run(grasping(reference, BOUNDS, time_step_s=1e-3, control_period_s=4e-3, duration_s=1.2))
    assert capture.time_s == pytest.approx(run.grasps[0].time_s, abs=1e-10)


def test_bounds_that_hold_when_armed_capture_at_once(tmp_path):
    phases = [
        {"name": "wait", "for_s": 0.8, "controller": OFF},
        {"name": "meet", "until": "grasp", "arm": ["grasp"], "controller": OFF},
        {"name": "hold", "until": "end", "controller": OFF},
    ]
    run = proved(ffsm_mj.run(grasping(tmp_path, BOUNDS, phases=phases, duration_s=1.0)))
    assert [phase.start_s for phase in run.phases] == [0.0, pytest.approx(0.8), pytest.approx(0.8)]


def test_a_grasp_that_never_closes_is_told_of_once_per_arming(tmp_path):
    phases = [
        {"name": "try", "for_s": 0.5, "arm": ["grasp"], "controller": OFF},
        {"name": "rest", "for_s": 0.5, "controller": OFF},
        {"name": "again", "until": "end", "arm": ["grasp"], "controller": OFF},
    ]
    run = proved(ffsm_mj.run(grasping(tmp_path, NEAR, phases=phases, duration_s=1.2)))
    first, second = run.records["near_misses"]
    assert (first.time_s, second.time_s) == (pytest.approx(0.5), pytest.approx(1.2))
    assert first.least_s == pytest.approx(0.5)
    assert 1.0 < second.least_ratio < 4.0
    assert first.position_m / 0.05 == pytest.approx(first.least_ratio)
    assert run.summary()["near_misses"][0]["least_ratio"] == first.least_ratio
    assert "qpos" not in run.summary()["near_misses"][0]
    assert run.summary()["near_misses"][0]["failed"] == "position_m"
    assert (first.failed_value, first.failed_bound) == (first.position_m, 0.05)
    report = run_report(run, ExplainedChecks(all_checks(run)))
    assert f"near miss of 'grasp': distance {first.position_m:.4g} m, bound 0.05 m ({first.least_ratio:.4g} times)" in report
    assert run.grasps == ()


def test_a_miss_names_each_bound_that_failed(tmp_path):
    """The ball passes through the hand at 1 m/s: near enough, never slow enough; turning is not bounded."""
    within = {"position_m": 0.15, "angle_rad": 0.5, "speed_m_s": 0.4}
    near = {"robot_site": "robot/centre", "object_site": "target/centre", "when": {"within": within}}
    rates = {"target/free": [-1.0, 0, 0, 0, 0, 0]}
    path = scene(
        tmp_path,
        ball("ball"),
        {"target": ball("target")},
        initial={"joints": {"target/free": [0.1, 0, 0, 1, 0, 0, 0]}, "rates": rates},
        grasps={"grasp": near},
        contacts={"rules": []},
        phases=[{"name": "try", "until": "end", "arm": ["grasp"], "controller": OFF}],
        duration_s=0.2,
    )
    run = proved(ffsm_mj.run(path))
    (miss,) = run.records["near_misses"]
    assert miss.bounds == {name: (bound,) for name, bound in within.items()}
    assert (miss.failed, miss.failed_bound) == ("speed_m_s", 0.4)
    assert miss.failed_value == miss.speed_m_s == pytest.approx(1.0, abs=1e-12)
    (told,) = run.summary()["near_misses"]
    assert (told["failed"], told["failed_value"], told["failed_bound"]) == ("speed_m_s", miss.speed_m_s, 0.4)
    (line,) = [
        line for line in run_report(run, ExplainedChecks(all_checks(run))).splitlines() if "near miss of 'grasp'" in line
    ]
    assert "near miss of 'grasp': relative speed 1 m/s, bound 0.4 m/s (2.5 times); closest approach at t = " in line
    assert "distance" not in line
    asked = ["near_misses.0.failed", "near_misses.0.failed_value", "near_misses.0.failed_bound"]
    metrics = metric_values(run, asked)
    assert [metrics[name] for name in asked] == ["speed_m_s", miss.speed_m_s, 0.4]
    assert all(fault_of(name, []) is None for name in asked)


def test_a_miss_before_an_impact_does_not_look_behind_it(tmp_path):
    """A ball that bounces off the hand in the middle of a step is no nearer than where it touches."""
    near = {"robot_site": "robot/centre", "object_site": "target/centre", "when": {"within": {"position_m": 0.05}}}
    path = scene(
        tmp_path,
        ball("ball"),
        {"target": ball("target")},
        initial={"joints": {"target/free": [0.5037, 0, 0, 1, 0, 0, 0]}, "rates": {"target/free": [-1.0, 0, 0, 0, 0, 0]}},
        contacts={"rules": [{"between": ["ball", "target/target"]}]},
        grasps={"grasp": near},
        phases=[{"name": "try", "until": "end", "arm": ["grasp"], "controller": OFF}],
        time_step_s=1e-2,
        control_period_s=1e-2,
    )
    run = proved(ffsm_mj.run(path))
    (miss,) = run.records["near_misses"]
    assert (miss.least_ratio, miss.least_s) == (pytest.approx(4.0, abs=1e-12), pytest.approx(0.3037, abs=1e-12))


def test_taken_let_go_and_taken_again(tmp_path):
    sites = {"robot_site": "grip", "object_site": "handle"}
    wide = {"within": {"position_m": 0.2, "speed_m_s": 1.0}}
    phases = [
        {"name": "meet", "until": "grasp", "arm": ["grasp"], "controller": OFF},
        {"name": "hold", "for_s": 0.3, "controller": HOLD},
        {"name": "leave", "for_s": 0.05, "release": ["grasp"], "controller": OFF},
        {"name": "meet_again", "until": "grasp", "arm": ["wide"], "controller": OFF},
        {"name": "hold_again", "for_s": 0.2, "controller": OFF},
        {"name": "leave_and_take", "until": "end", "release": ["wide"], "arm": ["wide"], "controller": OFF},
    ]
    grasps = {"grasp": {**sites, "when": BOUNDS}, "wide": {**sites, "when": wide}}
    run = proved(ffsm_mj.run(grasping(tmp_path, grasps=grasps, phases=phases, duration_s=1.5)))
    first, second, third = run.grasps
    assert [each.grasp for each in run.grasps] == ["grasp", "wide", "wide"]
    assert first.release_s < second.time_s < second.release_s == third.time_s
    assert third.release_s is None
    assert third.loss_J < 1e-25


def test_let_go_at_once_leaves_the_common_twist(tmp_path):
    """Released where it was taken, the object has the twist of the hand at the object's place."""
    phases = [
        {"name": "meet", "until": "grasp", "arm": ["grasp"], "controller": OFF},
        {"name": "leave", "until": "end", "release": ["grasp"], "controller": OFF},
    ]
    run = proved(ffsm_mj.run(grasping(tmp_path, BOUNDS, phases=phases, duration_s=1.0)))
    (capture,), (release,) = run.records["grasp_impulses"], run.records["releases"]
    assert release.time_s == capture.time_s
    assert release.qvel_after == capture.qvel_after


def test_what_is_held_is_hit(tmp_path):
    """By a third body, elastically: an impact on robot and object as one; with e < 1 it loses its share and goes on."""
    initial = {
        "joints": {"target/free": [1.3, 0.03, 0.02, 1, 0, 0, 0], "stone/free": [2.1, 0.05, 0, 1, 0, 0, 0]},
        "rates": {"target/free": [-0.3, 0, 0, 0.4, -0.2, 0.3], "stone/free": [-0.7, 0, 0, 0, 0, 0]},
    }
    for e in (1.0, 0.4):
        pairs = [
            {"between": ["hand", "target/target"], "restitution": 0.5},
            {"name": "late", "between": ["stone/stone", "target/target"], "restitution": e},
        ]
        folder = tmp_path / str(e)
        run = proved(
            ffsm_mj.run(
                grasping(folder, others={"stone": stone()}, initial=initial, contacts={"rules": pairs}, duration_s=2.0)
            )
        )
        (capture,) = run.records["grasp_impulses"]
        late = [impact for impact in run.impacts if impact.pair == "late"]
        assert len(late) == 1
        assert late[0].time_s > capture.time_s
        assert late[0].separation_speed_m_s == pytest.approx(e * late[0].approach_speed_m_s, rel=1e-10)
        assert late[0].linear_momentum_change_N_s < 1e-13
        before, after = (np.array(qvel["robot/free"]) for qvel in (late[0].qvel_before, late[0].qvel_after))
        assert np.abs(after - before).max() > 1e-3  # the robot feels it at once


@pytest.mark.long
def test_the_held_object_hits_the_base(tmp_path):
    """A pair of the robot and what it holds: not that of the hand, which is one rigid body with it, but that of the hull."""
    pairs = [
        {"between": ["hand", "target/target"], "restitution": 0.5},
        {"name": "hull", "between": ["hull", "target/target"], "restitution": 0.6},
    ]
    phases = [
        {"name": "meet", "until": "grasp", "arm": ["grasp"], "controller": OFF},
        {"name": "pull", "until": "end", "controller": {"kind": "pd", "kp": 3.0, "kd": 0.5, "target": [0.0, 2.9]}},
    ]
    path = grasping(tmp_path, phases=phases, contacts={"rules": pairs}, duration_s=4.0)
    run = proved(ffsm_mj.run(path))
    hits = [impact for impact in run.impacts if impact.pair == "hull"]
    assert hits
    assert hits[0].separation_speed_m_s == pytest.approx(0.6 * hits[0].approach_speed_m_s, rel=1e-9)
    assert [impact.pair for impact in run.impacts].count("hand-target/target") == 1
    # It bounces out, and lies there.
    assert hits[-1].restitution_used == 0.0
    assert [(begun.pair, begun.time_s) for begun in run.records["contact_beginnings"]] == [("hull", hits[-1].time_s)]


def test_a_law_is_made_for_what_moves(tmp_path):
    """While the object is held a law sees the system in which it is a part of the robot, and the free one beside it."""
    seen = []

    class Look(Law):
        def __init__(self, _, context):
            self._system = context.system

        def start(self, observation):
            seen.append(("start", self._system.grasp.name if self._system.grasp else "", observation.grasps))

        def control(self, observation, command):
            system = self._system
            assert observation.data.qpos.size == system.mj.nq
            assert observation.free.qpos.size == 16
            assert (system.grasp.name if system.grasp else "") == observation.attached
            mass = system.mj.body_subtreemass[system.robot.root]
            assert mass == pytest.approx(9.7 + 3.0 * bool(observation.grasps))
            place = [observation.data.xpos[system.index("body", "target/target")], observation.free.xpos[4]]
            np.testing.assert_allclose(*place, atol=1e-14)
            if observation.time_s == 1.5:
                command.requests.add("grasp.release")

    phases = [{"name": "all", "until": "end", "arm": ["grasp"], "controller": {"kind": "look"}}]
    run = ffsm_mj.run(grasping(tmp_path, phases=phases), controllers={"look": Look})
    assert run.outcome == "completed", run.message
    assert seen == [("start", "", ()), ("start", "grasp", ("grasp",)), ("start", "", ())]
    assert run.grasps[0].release_s == pytest.approx(1.5, abs=1e-12)


def test_what_a_law_believes_of_the_object_it_believes_of_what_is_held(tmp_path):
    seen = []

    class Look(Law):
        def __init__(self, _, context):
            self._model = context.system.mj

        def control(self, observation, _):
            root = self._model.body("target/target").id
            assert self._model.body_mass[root] == 5.0
            if observation.grasps:
                seen.append(float(self._model.body_subtreemass[1]))
                np.testing.assert_allclose(observation.data.xpos[root], observation.free.xpos[4], atol=1e-14)

    phases = [{"name": "all", "until": "end", "arm": ["grasp"], "controller": {"kind": "look"}}]
    path = grasping(tmp_path, phases=phases, controller_model={"target": {"target": {"mass_kg": 5.0}}}, duration_s=1.0)
    run = ffsm_mj.run(path, controllers={"look": Look})
    assert run.outcome == "completed", run.message
    assert seen
    assert seen == [pytest.approx(14.7)] * len(seen)
    assert all(check.passes for check in all_checks(run))


def test_a_closed_grasp_that_is_armed_is_refused_by_name(tmp_path):
    meet = {"name": "meet", "until": "grasp", "arm": ["grasp"], "controller": OFF}
    with pytest.raises(InputError) as error:
        prepare(grasping(tmp_path, phases=[meet, {**meet, "name": "again", "until": "end"}]))
    (line,) = error.value.lines
    assert ": phases.1.arm.0: 'grasp' cannot close: it is closed since the end of phase 'meet'; release it first" in line


def test_what_may_have_been_let_go_may_be_taken_again(tmp_path):
    """A phase, an end by a release or a law of one's own that may ask for it: no second grasp then."""
    meet = {"name": "meet", "until": "grasp", "arm": ["grasp"], "controller": OFF}
    last = {"name": "again", "until": "end", "arm": ["grasp"], "controller": OFF}
    for k, between in enumerate(
        (
            {"for_s": 0.1, "release": ["grasp"], "controller": OFF},
            {"until": "release", "controller": OFF},
            {"for_s": 0.1, "controller": {"kind": "lets"}},
        )
    ):
        phases = [meet, {"name": "between", **between}, last]
        prepare(grasping(tmp_path / str(k), phases=phases), controllers={"lets": Law})


@pytest.mark.parametrize(
    ("changes", "place", "what"),
    [
        (
            {"robot_site": "grap"},
            "grasps.grasp.robot_site",
            "unknown site of the robot 'grap' (did you mean 'robot/grip'?); allowed: robot/grip",
        ),
        (
            {"object_site": "knob"},
            "grasps.grasp.object_site",
            "unknown site of a floating object 'knob'; allowed: target/",
        ),
        ({"robot_site": "handle"}, "grasps.grasp.robot_site", "not a site of the robot: unknown site of the robot"),
        ({"object_site": "grip"}, "grasps.grasp.object_site", "not a site of a floating object"),
        ({"when": {}}, "grasps.grasp.when", "needs 'touch: [rule, ...]' or 'within"),
        ({"when": {"touch": ["hand-target/target"], **BOUNDS}}, "grasps.grasp.when", "one of the two"),
        ({"when": {"within": {}}}, "grasps.grasp.when.within", "needs one bound at least"),
        ({"when": {"touch": ["hand"]}}, "grasps.grasp.when.touch.0", "unknown contact rule or pair 'hand'"),
    ],
)
def test_what_is_wrong_with_a_capture_is_told_with_its_place(tmp_path, changes, place, what):
    grasps = {"grasp": {"robot_site": "grip", "object_site": "handle", "when": BOUNDS} | changes}
    with pytest.raises(InputError) as error:
        prepare(grasping(tmp_path, grasps=grasps))
    (line,) = error.value.lines
    assert f": {place}: " in line
    assert what in line


def test_what_a_phase_says_of_grasps_is_checked(tmp_path):
    phases = [
        {"name": "meet", "until": "grasp", "arm": ["grab"], "controller": OFF},
        {"name": "rest", "until": "end", "release": ["grab"], "controller": OFF},
    ]
    with pytest.raises(InputError) as error:
        prepare(grasping(tmp_path / "unknown", phases=phases))
    places = [line.split(": ")[1] for line in error.value.lines]
    assert places == ["phases.0.arm.0", "phases.1.release.0"]
    with pytest.raises(InputError, match="unknown end of a phase 'grasp'"):
        prepare(grasping(tmp_path / "none", grasps={}, phases=[{**phases[0], "arm": []}, {**phases[1], "release": []}]))


def test_a_phase_that_waits_for_a_capture_arms_one_or_a_law_may_have(tmp_path):
    wait = {"name": "wait", "until": "grasp", "controller": OFF}
    with pytest.raises(InputError, match=r"phases\.0\.until: no grasp is armed, .*; write 'arm: \[grasp\]'"):
        prepare(grasping(tmp_path / "none", phases=[wait]))
    asked = {"name": "ask", "for_s": 0.1, "controller": {"kind": "arms"}}
    prepare(grasping(tmp_path / "asked", phases=[asked, wait]), controllers={"arms": Law})
    prepare(grasping(tmp_path / "timed", phases=[{**wait, "for_s": 0.5}]))


def test_an_object_that_cannot_follow_and_a_law_that_cannot_drive_are_refused_when_read(tmp_path):
    path = grasping(tmp_path, initial={})
    (path.parent / "target.xml").write_text(FLAT_TARGET)
    with pytest.raises(InputError, match="the joints of 'target/target' cannot take the poses"):
        prepare(path)

    class Free(Law):
        def __init__(self, _, context):
            context.system.joint("target/free")

    phases = [{"name": "all", "until": "end", "controller": {"kind": "free"}}]
    with pytest.raises(
        InputError, match=r"while 'grasp' is closed: the controller cannot be made .*unknown joint 'target/free'"
    ):
        prepare(grasping(tmp_path / "law", phases=phases), controllers={"free": Free})


def test_check_lists_what_is_disarmed_and_the_watch_leaves_it_out(tmp_path, capfd):
    """Hand and target overlap by what was taken there; nobody tells of it while they are one body."""
    for name, contacts, noted in (("ruled", {}, 1), ("bare", {"rules": []}, 0)):
        path = grasping(tmp_path / name, BOUNDS, contacts=contacts, duration_s=1.0)
        assert main(["check", str(path)]) == 0
        note = "    while 'grasp' is closed, on one rigid body: "
        assert capfd.readouterr().out.count(note) == noted
    assert ffsm_mj.run(path).unhandled_contacts == ()


def test_check_says_which_grasp_no_phase_arms(tmp_path, capfd):
    sites = {"robot_site": "grip", "object_site": "handle"}
    grasps = {"grasp": {**sites, "when": TOUCH}, "spare": {**sites, "when": NEAR}}
    path = grasping(tmp_path / "scene", grasps=grasps)
    assert main(["check", str(path)]) == 0
    told = [line for line in capfd.readouterr().out.splitlines() if "arms" in line]
    assert told == ["note: no phase arms the grasp 'spare', so it never closes; write 'arm: [spare]' in a phase"]
    asked = {"name": "ask", "until": "end", "controller": {"kind": "arms"}}
    lines = prepare(grasping(tmp_path / "asked", phases=[asked]), controllers={"arms": Law}).describe()
    assert any("'grasp', so it never closes unless the control law of phase 'ask' requests it" in line for line in lines)


@pytest.mark.long
def test_the_log_of_a_run_with_captures(tmp_path, capfd):
    """Analysed from its file, run again from its folder, and a changed impulse is found."""
    out = tmp_path / "run"
    run = ffsm_mj.run(grasping(tmp_path / "scene"), out=out, rerun=False)
    assert main(["analyze", str(out)]) == 0
    assert "columns agree with states" in capfd.readouterr().out
    again = ffsm_mj.run(out)
    np.testing.assert_array_equal(again.qpos, run.qpos)
    (capture,) = run.records["grasp_impulses"]
    for name, value in (
        ("loss_J", capture.loss_J * (1.0 + 1e-6)),
        ("impulse_N_s", tuple(x + 1e-7 for x in capture.impulse_N_s)),
        ("time_s", math.nextafter(capture.time_s, 2.0) + 1e-6),
    ):
        records = {**run.log.records, "grasp_impulses": (dataclasses.replace(capture, **{name: value}),)}
        assert not replay_log(with_records(run.log, records)).agrees


def test_a_force_on_what_is_held_that_is_no_part_of_it_is_noticed(tmp_path):
    """The load of a row follows from its state and efforts: another number in the log is found."""
    run = ffsm_mj.run(grasping(tmp_path))
    rows = run.log.rows.copy()
    rows[1000, run.log.header.layout.index["contact.grasp_force_x_N"]] += 1e-7
    assert not replay_log(dataclasses.replace(run.log, rows=rows)).agrees


def test_an_object_that_outweighs_the_robot_is_held_by_scales_of_both(tmp_path):
    """What RK4 leaves of 1e6 kg at 5 ms is all in the robot's balance, which takes off the change of the object's energy."""
    path = grasping(tmp_path / "scene", time_step_s=0.005, control_period_s=0.005)
    target, share = tmp_path / "scene" / "target.xml", 1e6 / 3.0
    inertia = " ".join(f"{share * moment:.9g}" for moment in (0.04, 0.05, 0.06))
    heavy = TARGET.replace('mass="3"', 'mass="1e6"').replace('diaginertia="0.04 0.05 0.06"', f'diaginertia="{inertia}"')
    target.write_text(heavy)
    run = ffsm_mj.run(path)
    assert run.grasps
    laws = {(check.name, check.subsystem): check for check in all_checks(run)}
    assert all(law.passes for law in laws.values())
    robot, objects = (laws["energy", subsystem] for subsystem in ("robot", "objects"))
    assert robot.residual > 1e-9 * (1.0 + run["energy.robot_J"].max())  # more than its own energy would allow
    assert robot.tolerance < 1.01 * (objects.tolerance + 1e-9 * run["energy.robot_J"].max())
    # Until it is held the robot is judged by its own.
    free = ffsm_mj.run(path, {"duration_s": 0.5, "phases": [{"name": "meet", "until": "end", "controller": OFF}]})
    assert (
        next(check for check in all_checks(free) if (check.name, check.subsystem) == ("energy", "robot")).tolerance < 1.1e-9
    )
