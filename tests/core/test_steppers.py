"""Steps of the core: free ones are MuJoCo's to the last bit, those under forces Runge-Kutta's in plain NumPy."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

from ffsm_mj._core.steppers import BOUND_MARGIN, WHOLE_STATE, ForcedStepper, FreeStepper
from tests.core.arms import ARM, MOTORS, moving
from tests.scenes import compile_paths


def stepper(kind, model, data, *more):
    made = kind(model, data, np.empty(mujoco.mj_stateSize(model, WHOLE_STATE)), np.empty(model.nv), *more)
    made.clear(np.inf)
    return made


def test_free_steps_are_those_of_mujoco(case_study, rng):
    """Skipping the stages that are current changes no bit of the motion, efforts changing at every step."""
    model, start = case_study.mj, moving(case_study, rng)
    own, other, product = mujoco.MjData(model), mujoco.MjData(model), np.empty(model.nv)
    for data in (own, other):
        data.qpos[:], data.qvel[:] = start.qpos, start.qvel
        mujoco.mj_forward(model, data)
    flight, bound, clear = stepper(FreeStepper, model, own), 0.0, set()
    flight.clear(0.5)
    for effort in rng.uniform(-2.0, 2.0, (200, model.nu)):
        own.ctrl[:] = other.ctrl[:] = effort
        before = flight.energy
        clear.add(flight.step(1e-3))
        mujoco.mj_step(model, other)
        mujoco.mj_forward(model, other)
        mujoco.mj_mulM(model, other, product, other.qvel)
        assert flight.energy == pytest.approx(0.5 * other.qvel @ product, rel=1e-13)
        bound += BOUND_MARGIN * 1e-3 * np.sqrt(2.0 * max(before, flight.energy))
    for name in ("qpos", "qvel", "qacc", "site_xpos"):
        np.testing.assert_array_equal(getattr(own, name), getattr(other, name))
    assert flight.motion_bound == pytest.approx(bound, rel=1e-13)
    assert clear == {True, False}


def test_a_motion_that_is_not_finite_excludes_no_event(case_study):
    model = case_study.mj
    data = mujoco.MjData(model)
    flight = stepper(FreeStepper, model, data)
    data.qvel[0] = np.nan
    flight.clear(np.inf)
    model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_AUTORESET)
    assert not flight.step(1e-3)
    model.opt.disableflags &= ~int(mujoco.mjtDisableBit.mjDSBL_AUTORESET)
    assert np.isnan(flight.energy)


def test_arrays_of_another_size_are_refused(case_study):
    with pytest.raises(ValueError, match="do not fit the model"):
        FreeStepper(case_study.mj, mujoco.MjData(case_study.mj), np.empty(3), np.empty(case_study.mj.nv))


def test_a_step_under_forces_is_runge_kuttas(tmp_path, rng):
    """The classical tableau on the rotation vectors since the start of a step, in plain NumPy."""
    path = tmp_path / "robot.xml"
    path.write_text(ARM.format(options="", joint="", rest=MOTORS))
    system = compile_paths(path)
    model, data = system.mj, moving(system, rng)
    nv, h, other = model.nv, 2e-2, mujoco.MjData(model)

    def push(data):
        data.qfrc_applied += np.cos(data.time) - data.qvel - 0.3 * data.qpos[:nv]

    def rates(start, increment, after_s):
        """Rates of the increments, (2, nv)."""
        other.qpos[:] = start[0]
        mujoco.mj_integratePos(model, other.qpos, increment[0], 1.0)
        other.qvel[:], other.ctrl[:], other.time = start[1] + increment[1], data.ctrl, start[2] + after_s
        other.qfrc_applied[:] = 0.0
        mujoco.mj_forward(model, other)
        push(other)
        mujoco.mj_forward(model, other)
        turning = other.qvel.copy()
        t, w = increment[0, 3:6], turning[3:6].copy()
        turning[3:6] = w + np.cross(t, w) / 2.0 + np.cross(t, np.cross(t, w)) / 12.0
        return np.array((turning, other.qacc))

    steps = stepper(ForcedStepper, model, data, [push], lambda: None)
    for _ in range(5):
        start = data.qpos.copy(), data.qvel.copy(), data.time
        first = rates(start, np.zeros((2, nv)), 0.0)
        second = rates(start, 0.5 * h * first, 0.5 * h)
        third = rates(start, 0.5 * h * second, 0.5 * h)
        last = rates(start, h * third, h)
        end = h / 6.0 * (first + 2.0 * second + 2.0 * third + last)
        mujoco.mj_integratePos(model, start[0], end[0], 1.0)
        steps.step(h)
        # Sums of a few terms of the size of the state.
        np.testing.assert_allclose(data.qpos, start[0], rtol=0.0, atol=1e-13)
        np.testing.assert_allclose(data.qvel, start[1] + end[1], rtol=0.0, atol=1e-13)
        assert data.time == start[2] + h


@pytest.mark.parametrize("implicit", [False, True])
def test_both_kinds_of_steps_converge_to_one_motion(tmp_path, rng, implicit):
    """A tenth of the step leaves what order four leaves, at least."""
    path, ends = tmp_path / "robot.xml", []
    path.write_text(ARM.format(options="", joint="", rest=MOTORS))
    system = compile_paths(path)
    start = moving(system, rng)

    def push(data):
        data.qfrc_applied -= data.qvel

    for steps in (1, 2, 200):
        data = mujoco.MjData(system.mj)
        data.qpos[:], data.qvel[:] = start.qpos, start.qvel
        mujoco.mj_forward(system.mj, data)
        made = stepper(ForcedStepper, system.mj, data, [push], lambda: None)
        made.implicit = implicit and steps < 200
        for _ in range(steps):
            made.step(0.1 / steps)
        ends.append(np.concatenate((data.qpos, data.qvel)))
    whole, half = (np.abs(end - ends[-1]).max() for end in ends[:2])
    assert whole / half > 10.0


@pytest.mark.parametrize(
    ("options", "joint", "rest"),
    [
        ("", "", MOTORS),
        ("", "", ""),
        ('integrator="Euler"', "", MOTORS),
        ('integrator="implicitfast"', 'damping="5"', MOTORS),
        ("", 'frictionloss="0.5"', MOTORS),
        ("", 'range="-0.1 0.1" limited="true"', MOTORS),
        ("", "", MOTORS + '<equality><joint joint1="j1" joint2="j3"/></equality>'),
    ],
    ids=["free", "no motors", "Euler", "implicitfast", "friction", "limit", "equality"],
)
def test_what_is_not_conservative_is_mujocos_too(options, joint, rest):
    """Constraints and other integrators: where the stages cannot be skipped, they are not. To the last bit."""
    model = mujoco.MjModel.from_xml_string(ARM.format(options=options or 'integrator="RK4"', joint=joint, rest=rest))
    own, other = mujoco.MjData(model), mujoco.MjData(model)
    for data in (own, other):
        data.qvel[6:8] = 0.5, 0.3
        mujoco.mj_forward(model, data)
    flight = stepper(FreeStepper, model, own)
    for tick in range(300):
        own.ctrl[:] = other.ctrl[:] = np.sin(0.1 * tick)
        flight.step(model.opt.timestep)
        mujoco.mj_step(model, other)
        mujoco.mj_forward(model, other)
    np.testing.assert_array_equal(own.qpos, other.qpos)
    np.testing.assert_array_equal(own.qvel, other.qvel)
