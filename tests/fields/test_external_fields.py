"""External fields: forces in every stage of a step, in every motion, and their entries in the balance."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

import ffsm_mj
from ffsm_mj._core.tick import StageWork
from ffsm_mj.errors import InputError
from ffsm_mj.fields.interface import Field, StrictModel
from ffsm_mj.replay import replay_log
from tests.contact_models.grasp.scenes import TOUCH, grasping
from tests.fields.fields import DragConstant, FrozenPulse, Pulse, Stirring
from tests.scenes import HEAD, ball, box, scene, two_balls

UNIFORM = {"fields": [{"kind": "uniform", "acceleration_m_s2": [0.0, 0.0, -9.81]}]}
STIFF_ARM = f"""<mujoco>{HEAD}<worldbody><body name="base"><freejoint name="free"/>
      <inertial pos="0 0 0" mass="8" diaginertia="0.5 0.6 0.7"/>
      <body name="hand" pos="0.3 0 0"><joint name="wrist" axis="0 0 1"/>
      <inertial pos="0.1 0 0" mass="1" diaginertia="0.01 0.02 0.03"/></body></body></worldbody>
      <actuator><velocity name="wrist" joint="wrist" kv="2000"/></actuator></mujoco>"""
"""A link on a base with a servo so fast that steps are implicit."""
FIELDS = [DragConstant, Stirring, Pulse, FrozenPulse]


def failing(run):
    return [check for check in run.checks() if not check.passes]


def one_ball(folder, field, **keys):
    """A ball of 2 kg, at 3 m/s along x, under a field."""
    initial = {"joints": {"free": [0, 0, 0, 1, 0, 0, 0]}, "rates": {"free": [3.0, 0, 0, 0, 0, 0]}}
    keys = {"initial": initial, "environment": {"fields": [field]}} | keys
    return ffsm_mj.run(scene(folder, ball(mass=2.0), {}, **keys), fields=FIELDS)


def test_a_uniform_field_is_gravity(tmp_path):
    # A crate falls onto a slab, bounces and comes to rest under contact forces; the robot, a ball, falls beside.
    keys = {
        "duration_s": 0.6,
        "initial": {"joints": {"robot/free": [9, 0, 0, 1, 0, 0, 0], "box/free": [0, 0, 0.52, 1, 0, 0, 0]}},
        "contacts": {"rules": [{"between": ["box/box", "slab/slab"], "restitution": 0.3, "mu": 0.4}]},
        "fixed": {"slab": {}},
    }
    slab = '<geom name="slab" type="box" size="2 2 0.5" pos="0 0 -0.5" mass="0"/>'
    models = {"box": box(), "slab": f"<mujoco><worldbody>{slab}</worldbody></mujoco>"}
    runs = []
    for name, gravity, more in (
        ("gravity", "0 0 -9.81", {"conservative": False}),
        ("field", "0 0 0", {"environment": UNIFORM}),
    ):
        (tmp_path / name).mkdir()
        option = f'<option gravity="{gravity}"/>'
        texts = {
            key: text.replace('<option gravity="0 0 0"/>', "").replace("<mujoco>", f"<mujoco>{option}")
            for key, text in models.items()
        }
        robot = ball().replace('<option gravity="0 0 0"/>', option)
        runs.append(ffsm_mj.run(scene(tmp_path / name, robot, texts, **keys, **more)))
    falling, pushed = runs
    assert not failing(falling)
    assert not failing(pushed)
    assert len(falling.impacts) == len(pushed.impacts) > 3
    # Two ways of rounding in 600 steps, through impacts that double them at most.
    for key in falling.keys:
        other = key.replace("gravity", "field")
        np.testing.assert_allclose(pushed[other], falling[key], rtol=0.0, atol=3e-11, err_msg=key)
    assert pushed["balance.total_field_work_J"][-1] == pytest.approx(9.81 * (0.02 + 0.5 * 9.81 * 0.6**2), rel=1e-9)


def test_drag(tmp_path):
    # v = v0 exp(-c t / m); RK4 of 0.05 s with c/m = 0.4/s errs by (0.4 h)^5 / 120 of v per step: 1.07e-9 in 40 steps.
    run = one_ball(
        tmp_path, {"kind": "drag_constant", "coefficient_kg_s": 0.8}, duration_s=2.0, time_step_s=0.05, control_period_s=0.05
    )
    assert run["state.v_robot_free_vx_m_s"][-1] == pytest.approx(3.0 * np.exp(-0.8), rel=1.2e-9)
    assert run["balance.robot_field_work_J"][-1] == pytest.approx(9.0 * (np.exp(-1.6) - 1.0), rel=3e-9)
    assert run["balance.field_on_robot_P_x_N_s"][-1] == pytest.approx(6.0 * (np.exp(-0.8) - 1.0), rel=1.2e-9)


@pytest.mark.parametrize(("kind", "order"), [("pulse", 4.0), ("frozen_pulse", 1.0)])
def test_order(tmp_path, kind, order):
    # A force cos(w t): v = v0 + sin(w t) / (m w). Stages at their own times have Simpson's error, frozen ones that of Euler.
    errors = []
    for step_s in (0.1, 0.05):
        folder = tmp_path / f"{kind}{step_s}"
        folder.mkdir()
        field = {"kind": kind, "rate_rad_s": 2.0} | ({"step_s": step_s} if kind == "frozen_pulse" else {})
        run = one_ball(folder, field, time_step_s=step_s, control_period_s=step_s, duration_s=1.0)
        errors.append(abs(run["state.v_robot_free_vx_m_s"][-1] - 3.0 - np.sin(2.0) / 4.0))
    assert np.log2(errors[0] / errors[1]) == pytest.approx(order, abs=0.15)


@pytest.mark.parametrize("joint", ["rigid", "hinge"])
def test_a_grasp_under_a_field(tmp_path, joint):
    # A ball is caught, held in a motion of its own and let go; the field moves every body, and all checks stay on.
    latch = {"grasp": {"robot_site": "grip", "object_site": "handle", "when": TOUCH, "joint": joint}}
    if joint == "hinge":
        latch["grasp"]["axis"] = [0, 0, 1]
    path = grasping(
        tmp_path, environment={"fields": [{"kind": "stirring"}]}, grasps=latch, time_step_s=2e-3, control_period_s=2e-3
    )
    run = ffsm_mj.run(path, fields=FIELDS, out=tmp_path / "run")
    assert not failing(run)
    assert len(run.grasps) == 1
    assert abs(run["balance.objects_field_work_J"][-1]) > 1e-3
    again = replay_log(ffsm_mj.load_run(tmp_path / "run").log)
    assert again.agrees
    assert not [check for check in again.checks() if not check.passes]


def test_a_run_goes_on_bit_by_bit(tmp_path):
    path = two_balls(tmp_path, environment={"fields": [{"kind": "stirring"}]})
    whole = ffsm_mj.run(path, fields=FIELDS, out=tmp_path / "run")
    rest = ffsm_mj.resume(tmp_path / "run", 0.5)
    for key in whole.keys:
        np.testing.assert_array_equal(rest[key], whole[key][-len(rest.time) :], err_msg=key)


def test_two_balls_that_meet_under_a_field(tmp_path):
    path = two_balls(tmp_path, environment={"fields": [{"kind": "stirring"}]})
    run = ffsm_mj.run(path, fields=FIELDS)
    assert len(run.impacts) == 1
    assert not failing(run)


def test_without_a_field_there_are_no_columns(tmp_path):
    run = ffsm_mj.run(two_balls(tmp_path))
    assert not [key for key in run.keys if "field" in key]


def test_a_work_that_is_left_out_fails(tmp_path, monkeypatch):
    monkeypatch.setattr("ffsm_mj.balance.balance.StageWork", lambda done, account: StageWork(0.0 * done, account))
    run = ffsm_mj.run(two_balls(tmp_path, environment={"fields": [{"kind": "stirring"}]}), fields=FIELDS)
    assert {check.name for check in failing(run)} >= {"energy", "linear momentum"}


class _NoConfig(Field):
    kind = "bare"


@pytest.mark.parametrize(
    ("fields", "fault"),
    [
        ([{"kind": "unform"}], "environment.fields.0.kind: unknown external field 'unform' (did you mean 'uniform'?)"),
        ([{"acceleration_m_s2": [0, 0, 1]}], "environment.fields.0: needs a 'kind'; allowed:"),
        ([{"kind": "uniform"}], "environment.fields.0.acceleration_m_s2: "),
        ([{"kind": "uniform", "acceleration_m_s2": [0, 0]}], "environment.fields.0.acceleration_m_s2"),
    ],
)
def test_faults(tmp_path, fields, fault):
    with pytest.raises(InputError) as raised:
        ffsm_mj.run(two_balls(tmp_path, environment={"fields": fields}))
    assert fault in str(raised.value)


def test_unfit_classes_are_refused(tmp_path):
    class Other(Field):
        kind = "uniform"

        class Config(StrictModel):
            kind: str

    for unfit, fault in ((_NoConfig, "needs a Config"), (Other, "another external field has the kind 'uniform'")):
        with pytest.raises(InputError, match=fault):
            ffsm_mj.run(two_balls(tmp_path), fields=[unfit])


def test_implicit_steps(tmp_path):
    # A servo so fast that steps are implicit, on a slide between two bodies that a field accelerates and turns.
    run = ffsm_mj.run(
        scene(tmp_path, STIFF_ARM, {}, duration_s=0.2, environment={"fields": [{"kind": "stirring"}]}), fields=FIELDS
    )
    assert not failing(run)
    assert abs(run["balance.robot_field_work_J"][-1]) > 1e-3


def test_the_order_of_implicit_steps(tmp_path):
    # A servo that decays in 10 us is solved at the three nodes of Radau IIA. Whatever it does, forces cos(w t) on both
    # bodies give P = 2 sin(w t) / w: the error is that of the quadrature over the nodes, of order five. A field that is left
    # out of the nodes errs by all of P, one at another node's time by order one at best.
    errors = []
    for step_s in (0.1, 0.05):
        folder = tmp_path / str(step_s)
        folder.mkdir()
        keys = {
            "time_step_s": step_s,
            "control_period_s": step_s,
            "environment": {"fields": [{"kind": "pulse", "rate_rad_s": 2.0}]},
        }
        path = scene(folder, STIFF_ARM, {}, **keys)
        ffsm_mj.run(path, {"duration_s": step_s}, fields=FIELDS)  # registers them
        plant = ffsm_mj.Scenario.load(path).prepared.assemble().plant
        motion, impulse = plant.integrator.motion, 0.0
        assert motion.stiff is not None
        before = momentum(plant)
        for _ in range(round(1.0 / step_s)):
            motion.step(step_s)
            impulse += motion.field.done[0, 1]
            assert motion.is_solved
        # What the balance is told is what the motion has, to rounding of 20 steps.
        assert momentum(plant) - before == pytest.approx(impulse, abs=1e-14)
        errors.append(abs(impulse - np.sin(2.0)))
    assert np.log2(errors[0] / errors[1]) == pytest.approx(5.0, abs=0.1)


def momentum(plant):
    """Momentum of the robot along x."""
    model, data = plant.system.mj, plant.data
    mujoco.mj_subtreeVel(model, data)
    return float(model.body_subtreemass[1] * data.subtree_linvel[1, 0])
