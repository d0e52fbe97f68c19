"""An arm with a stiff servo pushes a free body: implicit steps enter what their contact gives each side."""

from __future__ import annotations

import numpy as np
import pytest

import ffsm_mj
from ffsm_mj.assembly import plant
from tests.replays import assert_replayed
from tests.scenes import HEAD, box, scene
from tests.servos.scenes import steps
from tests.servos.test_servos import passes

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
