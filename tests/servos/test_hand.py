"""A vendor's hand on a floating bus: two coupled fingers on half a tendon each, a servo whose gain is not its stiffness."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from ffsm_mj.analysis.run import Run
from tests.replays import assert_replayed
from tests.scenes import HEAD
from tests.servos.scenes import run_link, steps
from tests.servos.test_servos import passes

KP, KV, DAMPING, OPEN = 100.0, 10.0, 1.0, 0.04
_FINGERS = "".join(
    f"""<body name="{name}_finger" pos="0 0 0.0584" quat="{turn}"><inertial mass="0.015" pos="0 0 0"
    diaginertia="2.375e-6 2.375e-6 7.5e-7"/><joint name="{name}" armature="0.1" damping="{DAMPING}" axis="0 1 0" type="slide"
    range="0 0.04"/></body>"""
    for name, turn in (("left", "1 0 0 0"), ("right", "0 0 0 1"))
)
HAND = f"""<mujoco>{HEAD}<worldbody><body name="bus"><freejoint name="free"/>
  <inertial pos="0 0 0" mass="20" diaginertia="2 2 2"/><geom size="0.1" mass="0"/>
  <body name="hand" pos="0.1 0 0" quat="0 0 0 1"><inertial mass="0.73" pos="-0.01 0 0.03" diaginertia="0.001 0.0025 0.0017"/>
  {_FINGERS}</body></body></worldbody>
  <tendon><fixed name="split"><joint joint="left" coef="0.5"/><joint joint="right" coef="0.5"/></fixed></tendon>
  <equality><joint joint1="left" joint2="right"/></equality>
  <actuator><general name="hand" tendon="split" ctrlrange="0 255" forcerange="-100 100" gainprm="0.01568627451"
  biastype="affine" biasprm="0 -{KP} -{KV}"/></actuator></mujoco>"""
FINGER, RATE = "state.q_robot_left_m", "state.v_robot_left_m_s"
WORK, HEAT = "balance.work_J", "balance.total_damper_heat_J"
AT_END = {FINGER: 0.002345231911, RATE: -0.024413873141, WORK: 0.013344619293, HEAT: 0.013276075014}
"""At 0.3 s by the closed form of .115 q'' = -(kp q + kv q') / 2 - q' from 0.04 m, with the setpoint 0."""


def closing(folder, step_s):
    """The hand closes from its widest."""
    (folder / "setpoints.csv").write_text("time_s,actuators.robot_hand_applied\n0,0\n9,0\n")
    law = {"kind": "playback", "file": "setpoints.csv"}
    start = {"joints": {"left": OPEN, "right": OPEN}}
    return run_link(folder, law, model=HAND, initial=start, duration_s=0.3, **steps(step_s))


@pytest.mark.parametrize("step_s", [2e-3, 1e-3])
def test_a_hand_closes_as_its_law_says(tmp_path, step_s):
    """Work and heat of the dampers too; the bus feels nothing, and the coupling carries nothing.

    Steps are divided such that errors of the energy add up to 5e-10 J at most, half of what the checks allow at 1 J.
    """
    run = closing(tmp_path, step_s)
    for key, expected in AT_END.items():
        assert run[key][-1] == pytest.approx(expected, abs=5e-10), key
    np.testing.assert_allclose(run["state.q_robot_right_m"], run[FINGER], rtol=0.0, atol=1e-14)
    assert np.abs(run["state.v_robot_free_vx_m_s"]).max() < 1e-14
    assert passes(run)
    assert_replayed(run)


def test_damping_of_a_servo_booked_twice_is_found(tmp_path):
    """The control: with the heat of kv taken from the work once more, the energy does not balance."""
    run = closing(tmp_path, 2e-3)
    power = KV * run[RATE] ** 2
    heat = np.concatenate(([0.0], np.cumsum(0.5 * (power[1:] + power[:-1]) * np.diff(run.time))))
    rows = run.log.rows.copy()
    rows[:, run.keys.index(WORK)] -= heat
    assert passes(run)
    assert not passes(Run(replace(run.log, rows=rows)))
