"""Steps end at the dead bands of tendon springs and where curves of muscles meet: order four against fine integration."""

from __future__ import annotations

import pytest
from scipy.integrate import solve_ivp

from ffsm_mj.dynamics.actuators import ForceLimits
from tests.replays import assert_replayed
from tests.servos.scenes import INERTIA, link, run_link, steps
from tests.servos.test_servos import ANGLE, RATE, passes

LOW, HIGH = -0.05, 0.1
BAND = f'<tendon><fixed name="t" stiffness="4 1" springlength="{LOW} {HIGH}"><joint joint="j" coef="1"/></fixed></tendon>'
SERVO = '<position name="servo" joint="j" kp="1" kv=".05"/>'
MUSCLE = {
    "low": 0.75,
    "high": 1.05,
    "force": 1.0,
    "scale": 200,
    "lmin": 0.5,
    "lmax": 1.6,
    "vmax": 1.5,
    "fpmax": 1.3,
    "fvmax": 1.2,
}


def torque_of_band(q, _):
    """Of the spring beyond its band, -(a x + b x^2)."""
    x = max(q - HIGH, 0.0) + min(q - LOW, 0.0)
    return -4.0 * x - x * x


def torque_of_servo(q, v):
    """The same with a servo at its setpoint of .3."""
    return torque_of_band(q, v) + 0.3 - q - 0.05 * v


def torque_of_muscle(q, v):
    """Of an activation of .7, by the curves of MuJoCo's documentation, for lengths from -1 to 1 rad."""
    m = MUSCLE
    unit = 2.0 / (m["high"] - m["low"])
    length, rate = m["low"] + (q + 1.0) / unit, v / (unit * m["vmax"])
    rise, fall, most = 0.5 * (m["lmin"] + 1.0), 0.5 * (1.0 + m["lmax"]), m["fvmax"] - 1.0
    if length < rise:
        active = 0.5 * max((length - m["lmin"]) / (rise - m["lmin"]), 0.0) ** 2
    elif length < fall:
        active = 1.0 - 0.5 * ((length - 1.0) / ((1.0 - rise) if length < 1.0 else (fall - 1.0))) ** 2
    else:
        active = 0.5 * max((m["lmax"] - length) / (m["lmax"] - fall), 0.0) ** 2
    if rate < 0.0:
        active *= max(rate + 1.0, 0.0) ** 2
    else:
        active *= m["fvmax"] - max(most - rate, 0.0) ** 2 / most
    beyond = max(length - 1.0, 0.0) / (fall - 1.0)
    passive = m["fpmax"] * (0.5 * beyond**2 if beyond < 1.0 else beyond - 0.5)
    return -m["force"] * (0.7 * active + passive)


def run_of(folder, what, step_s):
    """1.6 s of a link from .2 rad at -.3 rad/s, and the law that plays its setpoint."""
    setpoint = 0.3 if what == "servo" else 0.7
    (folder / "setpoints.csv").write_text(f"time_s,robot/servo\n0,{setpoint}\n9,{setpoint}\n")
    numbers = " ".join(f"{value}" for value in MUSCLE.values())
    curves = f'gaintype="muscle" biastype="muscle" gainprm="{numbers}" biasprm="{numbers}" lengthrange="-1 1"'
    actuator = {"band": "", "servo": SERVO, "muscle": f'<general name="servo" joint="j" {curves}/>'}[what]
    model = link(actuator) if what == "muscle" else link(actuator).replace("</mujoco>", f"{BAND}</mujoco>")
    law = {"kind": "playback", "file": "setpoints.csv"} if actuator else {"kind": "off"}
    return run_link(folder, law, model=model, duration_s=1.6, **steps(step_s))


def errors_of(run, torque):
    """Of angle and rate at the end, against steps of at most 1 ms of order eight with an error of 1e-13."""
    settings = {"rtol": 1e-13, "atol": 1e-15, "max_step": 1e-3, "method": "DOP853"}
    fine = solve_ivp(lambda _, y: (y[1], torque(*y) / INERTIA), (0.0, 1.6), (0.2, -0.3), **settings).y[:, -1]
    return max(abs(run[ANGLE][-1] - fine[0]), abs(run[RATE][-1] - fine[1]))


@pytest.mark.long(one_of=3)
@pytest.mark.parametrize(
    ("what", "torque"), [("band", torque_of_band), ("servo", torque_of_servo), ("muscle", torque_of_muscle)]
)
def test_steps_end_at_kinks(tmp_path, monkeypatch, what, torque):
    """The error falls as the fourth power through them; the control: where steps pass kinks it is larger."""
    runs = [run_of(tmp_path, what, step_s) for step_s in (8e-3, 4e-3)]
    errors = [errors_of(run, torque) for run in runs]
    assert errors[1] < errors[0] / 13.0 + 2e-13  # 16, and the error of the reference
    assert all(passes(run) for run in runs)
    assert_replayed(runs[1])
    monkeypatch.setattr(ForceLimits, "first_kink", lambda _, path, __: path.move_to(0.0))
    assert errors_of(run_of(tmp_path, what, 8e-3), torque) > 15.0 * errors[0]
