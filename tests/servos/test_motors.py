"""DC motors with a limited voltage, a limited rate of the current, and LuGre friction, against an independent integration.

The oracle is SciPy's DOP853 on the equations of MuJoCo's manual, which restarts at each kink.
"""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from ffsm_mj.dynamics.actuators import MotorKinks
from tests.replays import assert_replayed
from tests.servos.scenes import INERTIA, steps
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


# Element, setpoint, its unit, activation at the start, rates, functions with roots at the kinks, fall of the error.
CASES = {
    "voltage": (
        f'<dcmotor name="servo" {MOTOR} input="pos" controller="{KP} 0 {KD} 0 0 {V_MAX}" '
        f'thermal="{R_TH} {CAPACITY} 0 {ALPHA} {REFERENCE} {AMBIENT}" cogging="{COGGING} {POLES} {PHASE}"/>',
        (12.0, "", 1.0),
        of_voltage,
        [lambda u, x: voltage(u, x) - V_MAX],
        10.0,
    ),
    "rate of the current": (
        f'<dcmotor name="servo" {MOTOR} inductance="0 {TIME_S}" saturation="0 0 {CURRENT_RATE}"/>',
        (24.0, "", 0.0),
        of_current,
        [lambda u, x: current_slope(u, x) - CURRENT_RATE],
        10.0,
    ),
    "bristle": (
        f'<dcmotor name="servo" {MOTOR} lugre="{S0} {S1} {COULOMB} {STATIC} {STRIBECK}"/>',
        (6.0, "", 0.0),
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
    expected = oracle(rates, given[0], [0.2, -0.3, given[2]], 0.2, kinks)
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


@pytest.mark.parametrize("what", CASES)
def test_a_kink_inside_a_step_spoils_the_order(tmp_path, what, monkeypatch):
    """The control: no step ends at a kink."""
    located, _ = errors_of(tmp_path, what, 2e-3)
    monkeypatch.setattr(MotorKinks, "__bool__", lambda _: False)
    assert errors_of(tmp_path, what, 2e-3)[0] > 10.0 * located
