"""DC motors, dead bands of tendons and muscles against an independent integration, through the kinks of their laws.

The oracle is SciPy's DOP853 on the equations of MuJoCo's manual, which restarts at each kink.
"""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from tests.replays import assert_replayed
from tests.servos.scenes import INERTIA, link, playing, run_link, steps
from tests.servos.test_activations import ACTIVATION, MOTOR, run_of
from tests.servos.test_servos import ANGLE, RATE, passes

K, R, GEAR = 0.05, 2.0, 20.0
KP, KD, V_MAX = 0.01, 0.01, 3.0
R_TH, CAPACITY, ALPHA, REFERENCE, AMBIENT = 1.0, 0.5, 0.004, 22.0, 30.0
COGGING, POLES, PHASE = 0.004, 3, 0.3
CURRENT_RATE, TIME_S = 400.0, 0.02
S0, S1, COULOMB, STATIC, STRIBECK = 0.6, 0.002, 0.02, 0.03, 4.0


def voltage(setpoint, state):
    """Voltage of the controller without limit."""
    torque = KP * (setpoint - GEAR * state[0]) - KD * GEAR * state[1]
    return R / K * torque + K * GEAR * state[1]


def of_voltage(setpoint, state):
    """Rates of angle, rate and temperature above ambient under the limited voltage, with cogging."""
    resistance = R * (1.0 + ALPHA * (state[2] + AMBIENT - REFERENCE))
    current = (np.clip(voltage(setpoint, state), -V_MAX, V_MAX) - K * GEAR * state[1]) / resistance
    torque = K * current + COGGING * np.sin(POLES * GEAR * state[0] + PHASE)
    return [state[1], GEAR * torque / INERTIA, (resistance * current**2 - state[2] / R_TH) / CAPACITY]


def current_slope(setpoint, state):
    """Rate of the current without limit."""
    return ((setpoint - K * GEAR * state[1]) / R - state[2]) / TIME_S


def of_current(setpoint, state):
    """Rates of angle, rate and current."""
    slope = np.clip(current_slope(setpoint, state), -CURRENT_RATE, CURRENT_RATE)
    return [state[1], GEAR * K * state[2] / INERTIA, slope]


def of_bristle(setpoint, state):
    """Rates of angle, rate and bristle."""
    rate = GEAR * state[1]
    slope = rate - S0 * abs(rate) * state[2] / (COULOMB + (STATIC - COULOMB) * np.exp(-((rate / STRIBECK) ** 2)))
    torque = K * (setpoint - K * rate) / R - S0 * state[2] - S1 * slope
    return [state[1], GEAR * torque / INERTIA, slope]


# Element, setpoint, activation at the start, rates, functions with roots at the kinks, fall of the error.
CASES = {
    "voltage": (
        f'<dcmotor name="servo" {MOTOR} input="pos" controller="{KP} 0 {KD} 0 0 {V_MAX}" '
        f'thermal="{R_TH} {CAPACITY} 0 {ALPHA} {REFERENCE} {AMBIENT}" cogging="{COGGING} {POLES} {PHASE}"/>',
        (12.0, 1.0),
        of_voltage,
        [lambda u, x: voltage(u, x) - V_MAX],
        10.0,
    ),
    "rate of the current": (
        f'<dcmotor name="servo" {MOTOR} inductance="0 {TIME_S}" saturation="0 0 {CURRENT_RATE}"/>',
        (24.0, 0.0),
        of_current,
        [lambda u, x: current_slope(u, x) - CURRENT_RATE],
        10.0,
    ),
    "bristle": (
        f'<dcmotor name="servo" {MOTOR} lugre="{S0} {S1} {COULOMB} {STATIC} {STRIBECK}"/>',
        (6.0, 0.0),
        of_bristle,
        [lambda _, x: x[1]],
        4.0,  # its stiffness divides the steps, whose number does not double
    ),
}


def oracle(rates, setpoint, start, duration_s, kinks):
    """State at the end, from one kink to the next."""
    begin_s, state, signs = 0.0, np.array(start), [1.0] * len(kinks)
    while begin_s < duration_s - 1e-12:
        signs = [np.sign(kink(setpoint, state + 1e-9 * np.array(rates(setpoint, state)))) for kink in kinks]
        events = [lambda _, x, k=k, s=s: k(setpoint, x) * s + 1e-14 for k, s in zip(kinks, signs, strict=True)]
        for event in events:
            event.terminal, event.direction = True, -1
        done = solve_ivp(
            lambda _, x: rates(setpoint, x),
            (begin_s, duration_s),
            state,
            method="DOP853",
            events=events,
            rtol=1e-12,
            atol=1e-13,
        )
        begin_s, state = done.t[-1], done.y[:, -1]
    return state


def errors_of(folder, what, step_s):
    """Largest error of the state at .2 s, and the run."""
    element, given, rates, kinks, _ = CASES[what]
    run = run_of(folder, element, *given, 0.2, **steps(step_s))
    expected = oracle(rates, given[0], [0.2, -0.3, given[1]], 0.2, kinks)
    found = [run[key][-1] for key in (ANGLE, RATE, ACTIVATION)]
    return float(np.abs(np.array(found) - expected).max()), run


@pytest.mark.parametrize("what", CASES)
def test_a_motor_moves_as_its_law_says(tmp_path, what):
    """To order four through its kinks, and the replay agrees."""
    errors = [errors_of(tmp_path, what, step_s) for step_s in (2e-3, 1e-3)]
    assert errors[1][0] < errors[0][0] / CASES[what][-1] + 2e-10
    assert errors[1][0] < 2e-8
    assert passes(errors[1][1])
    assert_replayed(errors[1][1])


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


def run_with(folder, what, step_s):
    """1.6 s of a link from .2 rad at -.3 rad/s, and the law that plays its setpoint."""
    numbers = " ".join(f"{value}" for value in MUSCLE.values())
    curves = f'gaintype="muscle" biastype="muscle" gainprm="{numbers}" biasprm="{numbers}" lengthrange="-1 1"'
    actuator = {"band": "", "servo": SERVO, "muscle": f'<general name="servo" joint="j" {curves}/>'}[what]
    model = link(actuator) if what == "muscle" else link(actuator).replace("</mujoco>", f"{BAND}</mujoco>")
    law = playing(folder, 0.3 if what == "servo" else 0.7) if actuator else {"kind": "off"}
    return run_link(folder, law, model=model, duration_s=1.6, **steps(step_s))


def error_of(run, torque):
    """Of angle and rate at the end, against steps of at most 1 ms of order eight with an error of 1e-13."""
    settings = {"rtol": 1e-13, "atol": 1e-15, "max_step": 1e-3, "method": "DOP853"}
    fine = solve_ivp(lambda _, y: (y[1], torque(*y) / INERTIA), (0.0, 1.6), (0.2, -0.3), **settings).y[:, -1]
    return max(abs(run[ANGLE][-1] - fine[0]), abs(run[RATE][-1] - fine[1]))


@pytest.mark.long(one_of=3)
@pytest.mark.parametrize(
    ("what", "torque", "at_8_ms"),
    [("band", torque_of_band, 2e-9), ("servo", torque_of_servo, 3.2e-9), ("muscle", torque_of_muscle, 4e-11)],
)
def test_steps_end_at_kinks(tmp_path, what, torque, at_8_ms):
    """Of dead bands and of curves that meet: the error falls as the fourth power through them."""
    runs = [run_with(tmp_path, what, step_s) for step_s in (8e-3, 4e-3)]
    errors = [error_of(run, torque) for run in runs]
    assert errors[0] < at_8_ms
    assert errors[1] < errors[0] / 13.0 + 2e-13  # 16, and the error of the reference
    assert all(passes(run) for run in runs)
    assert_replayed(runs[1])
