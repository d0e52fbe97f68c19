"""Effort and base rotation in the summary of a run, against closed forms."""

from __future__ import annotations

import json
import math
from typing import Literal

import numpy as np
import pytest

import ffsm_mj
from ffsm_mj.controller_protocol import StrictModel
from tests.laws import Law
from tests.scenes import HEAD, scene

CART = f"""<mujoco>{HEAD}<worldbody><body name="cart"><joint name="x" type="slide" axis="1 0 0"/>
  <geom type="box" size=".1 .1 .1" mass="4"/></body></worldbody>
  <actuator><motor name="push" joint="x" ctrllimited="true" ctrlrange="-3 3"/></actuator></mujoco>"""
SPINNER = (
    f"""<mujoco>{HEAD}<worldbody><body name="bus">{{}}<geom type="sphere" size=".1" mass="4"/></body></worldbody></mujoco>"""
)
OFF = [{"name": "coast", "until": "end", "controller": {"kind": "off"}}]


class Push(Law):
    """A constant force."""

    class Config(StrictModel):
        """Nothing to set."""

        kind: Literal["push"]

    def control(self, observation, command):
        """Push with 3 N."""
        command.drive(slice(0, 1), 3.0)


def test_effort_of_a_constant_force(tmp_path):
    """3 N for 2 s on 4 kg: F^2 T, F^2 T^2 / (2 m), F; the motor is at its bound throughout."""
    path = scene(
        tmp_path,
        CART,
        {},
        duration_s=2.0,
        phases=[{"name": "push", "until": "end", "controller": {"kind": "push"}}],
    )
    run = ffsm_mj.run(path, controllers={"push": Push}, out=tmp_path / "out", rerun=False)
    expected = {"integral_u2": 18.0, "work_J": 9.0 * 4.0 / 8.0, "peak": 3.0, "at_bound": 1.0}
    assert ffsm_mj.effort(run)["robot_push"] == pytest.approx(expected, rel=1e-12)
    assert ffsm_mj.base_rotation(run) is None  # it does not turn
    summary = json.loads((tmp_path / "out" / "summary.json").read_text())
    assert summary["effort"] == ffsm_mj.effort(run) == ffsm_mj.effort(ffsm_mj.load_run(tmp_path / "out"))
    assert 0.0 < summary["law_wall_s_per_tick"] < summary["wall_s"] / run.log.outcome.controller_ticks


@pytest.mark.parametrize(
    ("joint", "final", "largest"),
    [
        ('<joint name="spin" axis="0 1 0"/>', 4.0, 4.0),
        ('<freejoint name="spin"/>', 2.0 * math.pi - 4.0, math.pi),
    ],
)
def test_the_rotation_of_the_base(tmp_path, joint, final, largest):
    """4 rad at 2 rad/s: about a hinge as they are, else the least angle; near pi a row of 1 ms is 2e-3 rad off."""
    rates = {"spin": 2.0 if "axis" in joint else [0, 0, 0, 0, 2.0, 0]}
    run = ffsm_mj.run(scene(tmp_path, SPINNER.format(joint), {}, duration_s=2.0, initial={"rates": rates}, phases=OFF))
    assert ffsm_mj.base_rotation(run)["final_rad"] == pytest.approx(final, abs=1e-9)
    assert ffsm_mj.base_rotation(run)["largest_rad"] == pytest.approx(largest, abs=2e-3)
    assert np.isfinite(list(ffsm_mj.base_rotation(run).values())).all()
