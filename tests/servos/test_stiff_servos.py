"""Servos too fast for explicit steps: implicit ones, divided in transients, by a closed form; and one that pushes a body."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

import ffsm_mj
from ffsm_mj.assembly import plant
from ffsm_mj.assembly.prepare import prepare
from ffsm_mj.dynamics.stiff_actuators import StiffActuators
from tests.replays import assert_replayed
from tests.scenes import HEAD, box, scene
from tests.servos.scenes import INERTIA, link, link_scene, playing, steps
from tests.servos.test_servos import ANGLE, HOLD, RATE, passes

KP, KV = 4.0e4, 8.0e3  # rates 5 and 2e4 1/s: RK4 diverges from steps of 0.14 ms on
STIFF = f'<position name="servo" joint="j" kp="{KP}" kv="{KV}"/>'


def closed_form(time_s, start, rate, setpoint):
    """Angle and rate of I_r q'' = kp (u - q) - kv q'."""
    slow, fast = np.sort(-np.roots([INERTIA, KV, KP]).real)
    of_fast = (rate + slow * (start - setpoint)) / (slow - fast)
    of_slow = start - setpoint - of_fast
    parts = of_slow * np.exp(-slow * time_s), of_fast * np.exp(-fast * time_s)
    return setpoint + parts[0] + parts[1], -slow * parts[0] - fast * parts[1]


@pytest.mark.parametrize("step_s", [2e-3, 5e-4])
def test_a_stiff_servo_moves_as_its_law_says(tmp_path, step_s):
    """Its work is what the kinetic energy gains, though the transient of 50 us is far below a step."""
    run = ffsm_mj.run(link_scene(tmp_path, HOLD, actuators=STIFF, duration_s=0.1, **steps(step_s)))
    angle, rate = closed_form(run["state.time_s"][1:], 0.2, -0.3, 0.7)
    np.testing.assert_allclose(run[ANGLE][1:], angle, rtol=0.0, atol=1e-10)
    np.testing.assert_allclose(run[RATE][1:], rate, rtol=0.0, atol=3e-9)
    gained = INERTIA * (run[RATE] ** 2 - 0.3**2) / 2.0
    np.testing.assert_allclose(run["balance.work_J"], gained, rtol=0.0, atol=1e-9)
    assert passes(run)
    assert run.summary()["smallest_step_s"] < 1.0 / 2e4 < step_s
    assert_replayed(run)


def test_setpoints_that_move_start_transients(tmp_path):
    """Each tick has one: the path is followed, the checks pass, and the replay makes the same sub-steps."""
    path = {"kind": "joint_path", "waypoints": [{"at_s": 0.1, "positions": [0.25]}]}
    scenario = link_scene(
        tmp_path, path, actuators=STIFF, initial={"joints": {"j": 0.2}}, duration_s=0.1, control_period_s=5e-3
    )
    run = ffsm_mj.run(scenario)
    assert run["controller.path_error_rad"].max() < 0.94 * 5e-3 / 1.9  # the setpoint is that of the start of a tick
    assert passes(run)
    assert_replayed(run)


def test_a_stiff_servo_presses_on_a_limit(tmp_path):
    """The joint stays there under the servo's whole force kp (u - q), which the limit takes."""
    model = link(STIFF, joint='range="-28.64788975654116 28.64788975654116" limited="true"')  # 0.5 rad
    run = ffsm_mj.run(link_scene(tmp_path, playing(tmp_path, 0.7), model=model, duration_s=0.4, **steps(2e-3)))
    slow = np.min(-np.roots([INERTIA, KV, KP]).real)
    hit = run.records["limit_impacts"][0].time_s
    # From q = 0.2 on its slow part alone: the fast one is over after 1 ms, and shifts the start by 0.3 / 2e4 rad.
    assert hit == pytest.approx(np.log(0.5 / 0.2) / slow, abs=1e-4)
    rests = run["state.time_s"] > hit
    assert np.abs(run[ANGLE][rests] - 0.5).max() < 1e-9
    np.testing.assert_allclose(run["contact.robot_j_limit_torque_N_m"][rests], -KP * 0.2, rtol=1e-8)
    assert passes(run)
    assert_replayed(run)


@pytest.mark.parametrize(
    ("actuator", "mechanical", "with_activations"),
    [
        # I_r q'' = kp (u - q) - kv q' + ki z, z' = u - q.
        (
            '<pid name="servo" joint="j" kp="8" kv=".6" ki="4000" input="pos"/>',
            [INERTIA, 0.6, 8.0],
            [INERTIA, 0.6, 8.0, 4000.0],
        ),
        # kp (w - q) - kv q', w' = (u - w) / .002 s.
        (
            '<position name="servo" joint="j" kp="8" kv=".6" timeconst=".002"/>',
            [INERTIA, 0.6, 8.0],
            np.polymul([INERTIA, 0.6, 8.0], [1.0, 500.0]),
        ),
        # -kv u q' with the greatest u, which is not that at the start.
        ('<damper name="servo" joint="j" kv="3" ctrlrange="0 50"/>', [INERTIA, 150.0], [INERTIA, 150.0]),
    ],
)
def test_the_fastest_rate_is_that_of_the_whole_loop(tmp_path, actuator, mechanical, with_activations):
    """The largest root of its characteristic polynomial, with the control at either end of its range."""
    model = prepare(link_scene(tmp_path, {"kind": "off"}, actuators=actuator)).system.mj
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    found = StiffActuators(model, data, lambda rows: rows).fastest()
    expected = [np.abs(np.roots(polynomial)).max() for polynomial in (mechanical, with_activations)]
    np.testing.assert_allclose(found, expected, rtol=1e-7)  # differences of 1e-4 of a force of about 1


SETPOINT = 5e-3
# A spring without damper, 343 1/s with the body: the tip pushes for a quarter of a period, 4.6 ms, and then pulls away.
ARM = f"""<mujoco>{HEAD}<worldbody><body name="base"><freejoint name="free"/>
  <inertial pos="0 0 0" mass="5" diaginertia="2 2 2"/><geom name="hull" size="0.1" mass="0"/>
  <body name="arm"><joint name="j" axis="0 0 1"/><inertial pos="0.3 0 0" mass="1" diaginertia="0.05 0.05 0.05"/>
  <geom name="tip" pos="0.5 0 0" size="0.05" mass="0"/></body></body></worldbody>
  <actuator><position name="servo" joint="j" kp="4e4"/></actuator></mujoco>"""


def push(folder, mu, step_s, duration_s):
    """A run that begins with the tip on the face of a box of 2 kg, off its centre, both at rest."""
    return ffsm_mj.run(
        scene(
            folder,
            ARM,
            {"box": box(mass=2.0, half=(0.2, 0.2, 0.2))},
            initial={"joints": {"box/free": [0.5, 0.25, 0.05, 1, 0, 0, 0]}},
            contacts={"rules": [{"between": ["tip", "box"], "restitution": 0.0, "mu": mu}]},
            phases=[{"name": "all", "until": "end", "controller": {"kind": "hold", "positions": [SETPOINT]}}],
            duration_s=duration_s,
            **steps(step_s),
        )
    )


@pytest.mark.long(one_of=2)
@pytest.mark.parametrize("mu", [0.0, 0.5])
def test_divided_steps_and_a_contact_that_ends_inside_one(tmp_path, mu):
    """Robot and objects gain what the contact gives them, as the checks say; with friction the tip sticks first."""
    step_s = 2e-3
    run = push(tmp_path, mu, step_s, 0.012)
    (end,) = (each.time_s for each in run.records["contact_endings"])
    assert 0.01 * step_s < end % step_s < 0.99 * step_s
    assert run.summary()["smallest_step_s"] < 0.1 * step_s
    assert passes(run)
    assert_replayed(run)


def test_whole_steps_converge(tmp_path, monkeypatch):
    """The energies close by order 5 of the method; the momentum of the body is the quadrature of the force that moves it."""
    monkeypatch.setattr(plant, "STIFF_STEP", 0.0)  # all steps are implicit
    monkeypatch.setattr(plant, "RESOLVED_STEP", np.inf)  # and none is divided
    left = []
    for step_s in (2e-3, 1e-3, 5e-4):
        run = push(tmp_path, 0.0, step_s, 0.004)
        assert run.summary()["smallest_step_s"] == 0.0
        assert run["contact.tip_box_force_N"].min() > 0.0
        left.append([np.abs(run[f"balance.{side}_energy_residual_J"]).max() for side in ("robot", "objects")])
        # Of 0.9 N s, and a unit in the last place in each of 8 steps.
        assert np.abs(run["balance.objects_residual_P_y_N_s"]).max() < 8 * 2.2e-16
    np.testing.assert_allclose(np.log2(np.divide(left[:-1], left[1:])), 5.0, atol=0.15)
