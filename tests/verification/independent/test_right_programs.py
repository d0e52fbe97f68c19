"""Independent checks pass by a wide margin, are the same at the end of a run and from its log, and see one wrong number."""

from __future__ import annotations

import json
from collections import deque
from dataclasses import replace

import numpy as np
import pytest

import ffsm_mj
from ffsm_mj.analysis.run_models import all_checks
from ffsm_mj.verification.independent.finding import TOLERANCES
from ffsm_mj.verification.independent.kept_rows import KeptRows, kept_rows
from tests.changed_logs import with_records
from tests.contact_models.grasp.scenes import closed_as_armed, grasping
from tests.mutants import scenes
from tests.scenes import falling_box
from tests.sensing.scenes import pushing
from tests.verification.independent.scenes import (
    SENSORS,
    bouncing,
    chain,
    changed,
    failing,
    holding,
    independent,
    measuring,
    pulled,
    sliding,
)

LATCHES = ["rigid", "ball", "hinge", "slide", "cylindrical"]


@pytest.fixture(scope="module")
def runs(tmp_path_factory):
    made = {
        "bouncing": bouncing,
        "pulled": pulled,
        "chain": chain,
        "sliding": sliding,
        "holding": holding,
        "measuring": measuring,
    }
    found = {name: make(tmp_path_factory.mktemp(name)) for name, make in made.items()}
    of_mutants = {
        make.__name__: make(tmp_path_factory.mktemp("scene"))
        for make in (scenes.bounces, scenes.hits, scenes.holds, scenes.orbits)
    }
    return found | {name: ffsm_mj.run(path) for name, path in of_mutants.items()}


def test_every_check_is_made_somewhere_and_passes(runs):
    """Residuals are rounding: a hundredth of what is allowed."""
    found = [check for run in runs.values() for check in independent(run).values()]
    assert {check.name for check in found} == set(TOLERANCES)
    assert max(check.residual / check.tolerance for check in found) < 1e-2


def test_a_run_has_at_its_end_the_checks_of_its_log(runs):
    for run in runs.values():
        at_end = [check for check in all_checks(run) if check.name in TOLERANCES]
        assert at_end == [*independent(run).values()]
        assert ffsm_mj.summary(run)["checks"]["passed"]


@pytest.mark.long(one_of=3)
@pytest.mark.parametrize("joint", LATCHES)
def test_the_load_of_every_latch(tmp_path, joint):
    """Closed off its axis, it turns and slides while the arm moves it: axes in a turning link."""
    axis = {} if joint in ("rigid", "ball") else {"axis": [0.0, 0.6, 0.8]}
    grasp = {
        "robot_site": "grip",
        "object_site": "handle",
        "when": {"touch": ["hand-target/target"]},
        "joint": joint,
        **axis,
    }
    found = independent(holding(tmp_path, grasps={"grasp": grasp}))
    for name in ("grasp load", "grasp twist", "grasp impulse"):
        assert found[name].residual < 1e-3 * found[name].tolerance


@pytest.mark.parametrize(
    ("scene", "key", "change", "name"),
    [
        ("sliding", "balance.friction_heat_J", np.negative, "heat of friction"),
        ("sliding", "balance.friction_heat_J", lambda heat: heat * (1.0 + 1e-6), "heat of friction"),
        ("holding", "contact.grasp_force_y_N", lambda force: force * (1.0 + 1e-6), "grasp load"),
        ("holding", "contact.grasp_torque_y_N_m", lambda torque: np.roll(torque, 1), "grasp load"),
        ("measuring", "sensor.robot_gyro_true_x_rad_s", lambda rate: rate + 1e-6, "sensor values"),
        ("measuring", "sensor.robot_acc_true_x_m_s2", lambda rate: rate + 1e-6, "sensor values"),
        ("measuring", "sensor.robot_gyro_x_rad_s", lambda rate: rate + 1e-9, "sensor noise"),
        ("measuring", "sensor.robot_attitude_sampled_s", lambda time: time + 0.02, "sensor times"),
    ],
)
def test_a_changed_column_fails_its_check(runs, scene, key, change, name):
    assert name in failing(changed(runs[scene], key, change))


@pytest.mark.parametrize(
    ("field", "change", "name"),
    [
        ("impulse_N_s", 1e-6, "grasp impulse"),
        ("angular_impulse_N_m_s", 1e-6, "grasp impulse"),
        ("qvel_after", 1e-6, "grasp twist"),
    ],
)
def test_a_changed_capture_fails_its_check(runs, field, change, name):
    log = runs["holding"].log
    (record,) = log.records["grasp_impulses"]
    value = getattr(record, field)
    if field == "qvel_after":
        value = value | {"robot/elbow": (value["robot/elbow"][0] + change,)}
    else:
        value = (value[0] + change, *value[1:])
    records = log.records | {"grasp_impulses": (replace(record, **{field: value}),)}
    assert name in failing(ffsm_mj.Run(with_records(log, records)))


HELD = [{"name": "hold", "until": "end", "controller": {"kind": "hold", "joints": ["j1", "j2"], "bandwidth_rad_s": 3.0}}]


@pytest.mark.long(one_of=2)
@pytest.mark.parametrize(
    ("make", "changes", "at_s", "names"),
    [
        (pushing, {"sensors": SENSORS, "seed": 5, "phases": HELD}, 0.2, {"sensor values", "sensor times", "sensor noise"}),
        (grasping, {"control_period_s": 0.01}, 1.0, {"grasp load"}),
    ],
)
def test_a_run_that_goes_on_from_another(tmp_path, make, changes, at_s, names):
    """Its first row is under efforts, with samples on their way and grasps closed, of a run whose log it does not have."""
    path = make(tmp_path, **changes)
    ffsm_mj.run(path, out=tmp_path / "before", rerun=False)
    scenario = json.loads(path.read_text()) | {"initial": {"from": "before", "at_s": at_s}}
    (tmp_path / "after.yaml").write_text(json.dumps(scenario))
    found = independent(ffsm_mj.run(tmp_path / "after.yaml"))
    assert names <= {*found}
    assert all(check.passes for check in found.values())


def test_what_a_log_lacks_is_left_out(runs):
    """Without a column of the state no model can be put to it; rows that are missing leave what acted between them open."""
    log = runs["holding"].log
    for gone in ("state.q_robot_elbow_rad", "contact.grasp_force_x_N"):
        layout = log.header.layout
        keep = [i for i, key in enumerate(layout.keys) if key != gone]
        header = replace(log.header, layout=replace(layout, signals=tuple(layout.signals[i] for i in keep)))
        assert "grasp load" not in independent(ffsm_mj.Run(replace(log, header=header, rows=log.rows[:, keep])))
    for lost in (slice(60, 90), slice(0, 90)):
        part = ffsm_mj.Run(replace(log, rows=np.delete(log.rows, lost, axis=0)))
        assert not failing(part)
        assert "grasp load" not in independent(part)
    damaged = ffsm_mj.Run(replace(log, damage="a chunk is lost"))
    assert not failing(damaged)
    assert "grasp load" not in independent(damaged)


@np.errstate(all="ignore")
def test_numbers_that_are_none_fail_or_are_left_out(runs):
    """They never raise an exception: a log may hold anything."""
    for run in runs.values():
        rows = run.log.rows.copy()
        rows[len(rows) // 2 :, 1:] = np.nan
        independent(ffsm_mj.Run(replace(run.log, rows=rows)))
        huge = np.where(np.abs(run.log.rows) > 0.0, 1e300, run.log.rows)
        huge[:, run.log.header.layout.time] = run.log.rows[:, run.log.header.layout.time]
        independent(ffsm_mj.Run(replace(run.log, rows=huge)))


def test_kept_rows_do_not_depend_on_blocks(runs):
    """In blocks of 1 and of 7 with impacts told just before the rows that follow them, and whole: the same rows."""
    log = runs["measuring"].log
    whole, times = kept_rows(log), log.column("state.time_s")
    for size in (1, 7):
        told = deque(sorted(record.time_s for record in log.impact_records))
        kept = KeptRows(log.header.layout, log.header.metadata)
        for first in range(0, len(times), size):
            block = log.rows[first : first + size]
            while told and told[0] <= times[first + len(block) - 1]:
                kept.expect((told.popleft(),))
            kept.rows(block)
        assert kept.spread.kept == whole.spread.kept
        assert kept.before.kept == whole.before.kept
        assert {c: s.kept for c, s in kept.samples.items()} == {c: s.kept for c, s in whole.samples.items()}
        assert all(np.array_equal(kept[n], whole[n], equal_nan=True) for n in whole.spread.kept)


def test_a_box_that_lands_all_but_flat_bounces(tmp_path):
    """Its corners hit one after another within 1e-7 s: where a distance has a kink, nothing is known of what presses it."""
    run = ffsm_mj.run(falling_box(tmp_path, [0, 0, 0.501, 1, 2e-8, 1e-8, 0], [0, 0, -1, 0, 0, 0]))
    assert len({impact.event for impact in run.impacts}) > 1
    assert [str(check) for check in all_checks(run) if not check.passes] == []


def test_events_at_one_instant_that_state_different_efforts(tmp_path):
    """A grasp closes as it is armed, and the next phase has another law: the efforts of the last record act."""
    run = ffsm_mj.run(closed_as_armed(tmp_path))
    stated = {str(each.efforts_after) for each in run.log.events if getattr(each, "time_s", 1.0) == 0.0}
    assert len(stated) > 1
    assert "sensor values" in independent(run)
    assert [str(check) for check in all_checks(run) if not check.passes] == []
