"""A grasp that opens at its load limit: at the root of the load inside a step, or at a tick whose efforts are too large."""

from __future__ import annotations

import numpy as np
import pytest

import ffsm_mj
from ffsm_mj.assembly.prepare import prepare
from ffsm_mj.errors import InputError
from ffsm_mj.log.scenario import compile_log
from tests.contact_models.grasp.scenes import OFF
from tests.contact_models.grasp.test_latch_runs import ANY, SITES, docking, loads
from tests.contact_models.limits import driven_by
from tests.replays import proved
from tests.scenes import HEAD, scene

START = {
    "joints": {"target/free": [1.08, 0.0, 0.0, 1, 0, 0, 0]},
    "rates": {
        "robot/free": [0, 0, 0, 0.02, -0.03, 0.05],
        "shoulder": 1.5,
        "elbow": -1.0,
        "target/free": [-0.1, 0.3, 0.5, 0.4, -2.0, 1.0],
    },
}


def swinging(folder, kind, limit=None, **changes):
    """A ball on a latch whose load changes as it swings; nothing is driven."""
    axis = {"axis": [0.0, 1.0, 0.3]} if kind == "hinge" else {}
    grasp = {**SITES, "joint": kind, **axis, "when": ANY, **({"load_limit": limit} if limit else {})}
    return docking(
        folder,
        "ball",
        grasps={"grasp": grasp},
        phases=[
            {"name": "swing", "until": "release", "arm": ["grasp"], "controller": OFF},
            {"name": "leave", "until": "end", "controller": OFF},
        ],
        contacts={"rules": []},
        **{"duration_s": 0.4, "initial": START, **changes},
    )


def _plain(values):
    return values.tolist() if len(values) > 1 else float(values[0])


def reversed_end(run):
    """The end of a run with all rates reversed: a start of the same motion backwards."""
    joints = compile_log(run.log).joints
    q, v = run.qpos[-1], -run.qvel[-1]
    return {
        "joints": {name: _plain(q[joint.qpos]) for name, joint in joints.items()},
        "rates": {name: _plain(v[joint.dofs]) for name, joint in joints.items()},
    }


@pytest.mark.long(one_of=2)
@pytest.mark.parametrize("kind", ["rigid", "hinge"])
def test_it_opens_at_the_root_of_the_load(tmp_path, kind):
    """The object swings inwards: its load grows, and reaches the limit between two samples of the run without one.

    The instant is the root whatever the step, to the truncation of the motion, and the logged load there is the limit.
    """
    start = reversed_end(ffsm_mj.run(swinging(tmp_path / "before", kind)))
    free = proved(ffsm_mj.run(swinging(tmp_path / "free", kind, initial=start)))
    force, at = np.linalg.norm(loads(free)[:, :3], axis=1), 250
    assert np.all(np.diff(force[2:]) > 0.0)
    limit_N = float(0.3 * force[at - 1] + 0.7 * force[at])
    times = []
    for step_s in (1e-3, 0.5e-3):
        changes = {"time_step_s": step_s, "control_period_s": 1e-3, "initial": start}
        run = proved(ffsm_mj.run(swinging(tmp_path / f"{step_s}", kind, {"force_N": limit_N}, **changes)))
        (release,) = run.records["releases"]
        assert release.reason == "load_limit"
        assert release.force_N == pytest.approx(limit_N, rel=1e-12)
        assert release.force_N >= limit_N
        assert release.qvel_before == release.qvel_after
        assert free.time[at - 1] < release.time_s < free.time[at]
        assert [phase.reason for phase in run.phases] == ["start", "release"]
        assert run.grasps[0].release_s == release.time_s
        assert run.grasps[0].peak_force_N <= limit_N
        times.append(release.time_s)
    assert times[0] == pytest.approx(times[1], abs=1e-9)


PAIR = """<mujoco>{head}<worldbody><body name="{body}"><joint name="x" type="slide" axis="1 0 0"/>
  <inertial pos="0 0 0" mass="{mass}" diaginertia="1 1 1"/><site name="{site}"/></body></worldbody>{motor}</mujoco>"""


def test_it_opens_at_the_tick_whose_efforts_are_too_large(tmp_path):
    """A force f on 3 kg that hold 1 kg gives a load of f / 4: with 1 N more at each tick 2.1 N are exceeded at 9 N."""
    motor = '<actuator><motor name="x" joint="x"/></actuator>'
    path = scene(
        tmp_path,
        PAIR.format(head=HEAD, body="cart", mass=3, site="hook", motor=motor),
        {"load": PAIR.format(head=HEAD, body="load", mass=1, site="ring", motor="")},
        duration_s=0.15,
        control_period_s=0.01,
        grasps={"grasp": {"robot_site": "hook", "object_site": "ring", "when": ANY, "load_limit": {"force_N": 2.1}}},
        contacts={"rules": []},
        phases=[{"name": "pull", "until": "end", "arm": ["grasp"], "controller": {"kind": "driven"}}],
    )
    run = proved(ffsm_mj.run(path, controllers=driven_by(lambda time_s: (1.0 + round(time_s / 0.01),))))
    (release,) = run.records["releases"]
    assert release.time_s == pytest.approx(0.08, abs=1e-12)
    assert release.force_N == pytest.approx(9.0 / 4.0, rel=1e-13)
    assert run["contact.grasp_closed"][-1] == 0.0


def test_a_limit_that_is_not_reached_changes_nothing(tmp_path):
    one, other = (
        ffsm_mj.run(swinging(tmp_path / str(k), "hinge", limit)) for k, limit in enumerate((None, {"force_N": 1e3}))
    )
    for key in one.keys:
        np.testing.assert_array_equal(one[key], other[key])


def test_a_limit_states_something(tmp_path):
    with pytest.raises(InputError, match=r"grasps.grasp.load_limit.* needs one limit at least: force_N, torque_N_m"):
        prepare(swinging(tmp_path, "rigid", {"force_N": None}))
