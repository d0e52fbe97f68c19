"""Order of the motion while contacts last, and its independence of the frame that it is seen from."""

from __future__ import annotations

import numpy as np
import pytest

import ffsm_mj
from ffsm_mj.analysis.run_models import all_checks
from ffsm_mj.contact_models.persistent import closed_contacts as closed
from tests.contact_models.persistent.random_pushes import LAWS
from tests.scenes import HEAD, box, scene

SPIN = 0.4


def arm(base):
    """Two links on a base, a ball at the tip."""
    return f"""<mujoco>{HEAD}<worldbody><body name="base">{base}
      <inertial pos="0 0 0" mass="5" diaginertia="0.3 0.3 0.3"/>
      <body name="upper" pos="0.2 0 0"><joint name="shoulder" axis="0 0 1"/>
        <inertial pos="0.2 0 0" mass="1" diaginertia="0.01 0.02 0.02"/>
        <body name="lower" pos="0.4 0 0"><joint name="elbow" axis="0 0 1"/>
          <inertial pos="0.2 0 0" mass="0.8" diaginertia="0.01 0.02 0.02"/>
          <geom name="tip" size="0.05" pos="0.4 0 0" mass="0"/></body></body></body></worldbody>
      <actuator><motor name="shoulder" joint="shoulder"/><motor name="elbow" joint="elbow"/></actuator></mujoco>"""


def turned(angle, vector):
    """A vector turned about z."""
    c, s = np.cos(angle), np.sin(angle)
    return [c * vector[0] - s * vector[1], s * vector[0] + c * vector[1], vector[2]]


def pushing(folder, *, step=2e-3, angle=0.0, boost=(0.0, 0.0, 0.0), duration=0.112):
    """Elbow out, the tip rests on a face of a free box; constant torques straighten the arm and push the box away.

    All of it turned about z and flying at ``boost``.
    """
    shoulder, elbow = 0.7, -1.4
    x, y = 0.2 + 0.4 * np.cos(shoulder) + 0.4 * np.cos(shoulder + elbow), 0.0
    turn = [np.cos(angle / 2), 0.0, 0.0, np.sin(angle / 2)]
    return scene(
        folder,
        arm('<freejoint name="free"/>'),
        {"box": box("box", mass=3.0, half=(0.2, 0.3, 0.25))},
        duration_s=duration,
        time_step_s=step,
        control_period_s=0.008,
        initial={
            "joints": {
                "shoulder": shoulder,
                "elbow": elbow,
                "robot/free": [0.0, 0.0, 0.0, *turn],
                "box/free": [*turned(angle, (x + 0.05 + 0.2, y + 0.03, 0.0)), *turn],
            },
            "rates": {"robot/free": [*boost, 0, 0, 0], "box/free": [*boost, 0, 0, 0]},
        },
        contacts={"rules": [{"between": ["tip", "box/box"], "restitution": 0.0}]},
        phases=[
            {
                "name": "push",
                "until": "end",
                "controller": {"kind": "pushes", "efforts": [[-3.0, 6.0]], "hold_s": 1.0},
            }
        ],
    )


def pushed(folder, **given):
    """A run that is in contact from its first row to its last, without an event but the beginning."""
    run = ffsm_mj.run(pushing(folder, **given), controllers=LAWS)
    assert run.outcome == "completed"
    assert run["contact.tip_box_box_force_N"][1:].min() > 0.1
    assert len(run.records["contact_beginnings"]) == 1
    assert not run.records["contact_endings"]
    return run


def final(run):
    """Coordinates and rates at the end."""
    return np.array([run[key][-1] for key in run.keys if key.startswith("state.")])


def test_order_four_while_a_contact_lasts(tmp_path, monkeypatch):
    """From a start in contact, no release: errors at steps of 8, 4 and 2 ms against 0.5 ms fall by 2^3.8 and more each.

    Efforts are held for 8 ms in all of them. This box has rotations and a face that turns, and is pushed so hard that errors
    stand clear of what is left of drift, 1e-10 m/s. In steps of 8 and 4 ms its gap then drifts by more than a step may, and
    cuts there make those better than their order: here they are not cut. Nothing is changed in ``test_planar_arm``.
    """
    monkeypatch.setattr(closed, "DRIFT_M", 1e-4)
    monkeypatch.setattr(closed, "DRIFT_M_S", 1e-2)
    runs = {step: pushed(tmp_path, step=step) for step in (8e-3, 4e-3, 2e-3, 5e-4)}
    states = {step: final(run) for step, run in runs.items()}
    errors = [np.abs(states[step] - states[5e-4]).max() for step in (8e-3, 4e-3, 2e-3)]
    # The error is no rounding, and the motion moved: else the ratios would say nothing.
    assert errors[2] > 1e-13
    assert np.log2(errors[0] / errors[1]) >= 3.8
    assert np.log2(errors[1] / errors[2]) >= 3.8
    for step, run in runs.items():
        assert run["balance.deepest_overlap_m"].max() <= 1e-9
        if step <= 1e-3:
            assert all(check.passes for check in all_checks(run))
    # Energy less work falls as fast.
    left = [np.abs(runs[step]["balance.total_energy_residual_J"]).max() for step in (8e-3, 4e-3, 2e-3)]
    assert np.log2(left[0] / left[1]) >= 3.8
    assert np.log2(left[1] / left[2]) >= 3.8


@pytest.mark.parametrize(("angle", "boost"), [(SPIN, (0.0, 0.0, 0.0)), (0.0, (0.7, -0.4, 0.3)), (-1.1, (-0.2, 0.5, 0.1))])
def test_a_turned_and_boosted_scene_is_the_same(tmp_path, angle, boost):
    """Joint angles, rates, forces and impulses to 1e-9: RK4 itself knows of no frame but for what it leaves at 2 ms."""
    one, other = pushed(tmp_path), pushed(tmp_path, angle=angle, boost=boost)
    keys = [key for key in one.keys if "shoulder" in key or "elbow" in key or key.endswith(("_force_N", "_impulse_N_s"))]
    assert len(keys) >= 6
    for key in keys:
        np.testing.assert_allclose(
            other[key], one[key], rtol=0, atol=1e-9 * (1.0 + np.nanmax(np.abs(one[key]))), err_msg=key
        )
