"""Copies of live arrays, limits of efforts and their work, against NumPy and MuJoCo's own functions."""

from __future__ import annotations

import math

import mujoco
import numpy as np
import pytest

from ffsm_mj._core.tick import Limits, Maxima, Periodically, Sampler, StepWork
from ffsm_mj.actuation.limits import Envelope
from tests.core.arms import moving


class Part:
    """A part of the balance that notes its calls."""

    def __init__(self):
        self.calls = []

    def open(self):
        self.calls.append("open")

    def close(self, duration_s):
        self.calls.append(duration_s)


def test_work_is_force_times_length(case_study, rng):
    """Of actuators on joints; parts outside take part in steps with an external effort, others in every step."""
    model, account = case_study.mj, np.zeros(3)
    on_joint, external, work = np.ones(model.nu), np.zeros(model.nu), 0.0
    on_joint[0], external[1] = 0.0, 1.0
    data = moving(case_study, rng)
    always, outside = Part(), Part()
    balance = StepWork(data, on_joint, external, account, np.zeros(3), np.zeros(6), np.zeros(12), [always], [outside])
    for step in range(20):
        if step == 10:
            data.ctrl[:] = 0.0
        balance.open()
        lengths = data.actuator_length.copy()
        mujoco.mj_step(model, data)
        mujoco.mj_forward(model, data)
        work += (on_joint * data.ctrl * model.actuator_gear[:, 0]) @ (data.actuator_length - lengths)
        balance.close(0.1 * step)
        assert [len(part.calls) for part in (always, outside)] == [2 * step + 2, min(2 * step + 2, 20)]
    # A sum of some tens of terms.
    np.testing.assert_allclose(account, (work, 0.0, 0.0), rtol=1e-14)
    assert always.calls[:4] == outside.calls[:4] == ["open", 0.0, "open", 0.1]


def test_maxima_begin_again_at_each_sample():
    since, logged = np.array([1.0, 0.0]), np.zeros(2)
    sample = Maxima(since, logged)
    sample(0.0)
    assert (since.tolist(), logged.tolist()) == ([0.0, 0.0], [1.0, 0.0])
    since[1] = 2.0
    sample(1.0)
    assert logged.tolist() == [0.0, 2.0]


def test_a_period_is_a_function_of_the_times_of_two_samples():
    """Samples at exact multiples of 0.02 s and between; a sample whose values are logged is not evaluated again."""
    calls = []
    sample = Periodically(0.02, lambda: calls.append(time_s))
    for time_s in (step * 0.001 for step in range(100)):
        sample(time_s)
    assert calls == pytest.approx([0.0, 0.02, 0.04, 0.06, 0.08])
    kept = sample.last_s, sample.is_resumed
    sample.resume(True)
    for time_s in (0.1, 0.119):
        sample(time_s)
    assert len(calls) == 5
    sample.last_s, sample.is_resumed = kept
    for time_s in (0.1, 0.119):
        sample(time_s)
    assert calls[5:] == [0.1]


def test_a_row_is_what_is_live(case_study, rng):
    """Strided tables and arrays of any rank; Jacobians, subtree velocities and the velocity of the tip are refreshed."""
    model, root = case_study.mj, case_study.robot.root
    data, site = moving(case_study, rng), case_study.index("site", "tip")
    sampler, wide = Sampler(model, data, base=root, tip=site), np.full((4, model.nq + 8), np.nan)
    live = (data.qpos, sampler.twist[3:], data.xpos[root], sampler.jacp, data.subtree_linvel, np.zeros(0))
    own = [wide[:, 1 : 1 + model.nq], wide[:, -3:], *(np.zeros((4, *array.shape)) for array in live[2:])]
    sampler.copy(list(zip(live, own, strict=True)))
    for line in (2, 0):
        data.qpos[:] += 0.1
        mujoco.mj_forward(model, data)
        sampler.take(line)
        twist, jacp, jacr = np.zeros(6), *np.zeros((2, 3, model.nv))
        mujoco.mj_subtreeVel(model, data)
        mujoco.mj_jacBody(model, data, jacp, jacr, root)
        mujoco.mj_objectVelocity(model, data, mujoco.mjtObj.mjOBJ_SITE, site, twist, 0)
        for table, value in zip(own, (data.qpos, twist[3:], data.xpos[root], jacp, data.subtree_linvel), strict=False):
            np.testing.assert_array_equal(table[line], value)
    assert np.isnan(wide[[1, 3]]).all()
    assert np.isnan(wide[:, 0]).all()


def test_what_cannot_be_copied_is_refused(case_study):
    sampler = Sampler(case_study.mj, mujoco.MjData(case_study.mj))
    for live, table in (
        (np.zeros(3), np.zeros((4, 2))),
        (np.zeros(3, dtype=np.float32), np.zeros((4, 3))),
        (np.zeros(6)[::2], np.zeros((4, 3))),
        (np.zeros(3), np.zeros((4, 6))[:, ::2]),
    ):
        with pytest.raises(ValueError, match="cannot copy"):
            sampler.copy([(live, table)])
    sampler.copy([(np.zeros(3), np.zeros((4, 3)))])
    with pytest.raises(IndexError, match="line 4 of a table of 4"):
        sampler.take(4)


def limited(envelope, i, effort, velocity):
    """Applied effort of one actuator, its lower and its upper bound."""
    low, high, stall, slope, saturation, gear, _ = (float(values[i]) for values in vars(envelope).values())
    lower, upper = max(low, -stall - slope * velocity), min(high, stall - slope * velocity)
    lower = 0.0 if velocity / gear <= -saturation else lower
    upper = 0.0 if velocity / gear >= saturation else upper
    return min(max(effort, lower), upper), lower, upper


def test_limits(rng):
    """Ranges, torque-speed lines, saturated wheels of either sign of gear, unpowered and not finite efforts."""
    count = 6
    for _ in range(300):
        envelope = Envelope(
            low=np.where(rng.random(count) < 0.5, -np.inf, -rng.random(count)),
            high=np.where(rng.random(count) < 0.5, np.inf, rng.random(count)),
            stall=np.where(rng.random(count) < 0.3, np.inf, rng.random(count)),
            slope=np.where(rng.random(count) < 0.5, 0.0, rng.normal(size=count)),
            saturation=np.where(rng.random(count) < 0.5, np.inf, rng.random(count)),
            gear=rng.choice([-2.0, 0.5, 1.0], count),
            keeps=rng.random(count) < 0.3,
        )
        effort, powered, velocity = rng.normal(size=count), rng.random(count) < 0.7, rng.normal(size=count)
        if rng.random() < 0.2:
            effort[rng.integers(count)] = rng.choice([np.nan, np.inf])
        table, ctrl = np.zeros((count, 4)), np.zeros(count)
        table[:, 0] = rng.normal(size=count)
        # A servo that is not commanded keeps its setpoint.
        commanded = np.where(powered, effort, np.where(envelope.keeps, table[:, 0], 0.0))
        assert Limits(envelope, effort, powered, velocity, table, ctrl).apply() == np.isfinite(commanded).all()
        np.testing.assert_array_equal(table[:, 0], commanded)
        for i, wanted in enumerate(commanded):
            if np.isfinite(commanded).all():
                applied, lower, upper = limited(envelope, i, wanted, velocity[i])
                applied = applied if powered[i] or envelope.keeps[i] else 0.0
                assert (*table[i, 1:], ctrl[i]) == (applied, lower, upper, applied / envelope.gear[i])


def test_arrays_of_other_actuators_are_refused():
    envelope = Envelope(*np.ones((6, 2)), np.zeros(2, dtype=np.bool_))
    with pytest.raises(ValueError, match="do not fit together"):
        Limits(envelope, np.zeros(2), np.ones(2, dtype=bool), np.zeros(3), np.zeros((2, 4)), np.zeros(2))
    assert math.isfinite(envelope.gear[0])
