"""Rims that lie almost flat: contact forces go as the inverse of a tilt, which a state determines to rounding only."""

from __future__ import annotations

from dataclasses import replace

import mujoco
import numpy as np
import pytest

import ffsm_mj
from ffsm_mj.analysis.run_models import all_checks
from ffsm_mj.replay import replay_log
from tests.changed_logs import with_records
from tests.contact_models.grasp.scenes import OFF
from tests.scenes import scene

PLATE = """<mujoco><option gravity="0 0 0"/><worldbody><body name="base"><freejoint name="free"/>
  <inertial pos="0.02 0.01 0" mass="8" diaginertia="0.5 0.6 0.7"/>
  <geom name="plate" type="box" size="0.5 0.5 0.1" mass="0"/><site name="grip" pos="0.2 0.1 0.2"/>
  </body></worldbody></mujoco>"""

CAN = """<mujoco><option gravity="0 0 0"/><worldbody><body name="can"><freejoint name="free"/>
  <inertial pos="0.01 -0.02 0.01" mass="3" diaginertia="0.04 0.05 0.06"/>
  <geom name="can" type="cylinder" size="0.1 0.05" mass="0"/><site name="handle" pos="0.2 0.1 0.05"/>
  </body></worldbody></mujoco>"""

POSITION, ROTATION = np.array([0.1, 0.2, 0.3]), np.array([0.7, 0.1, -0.3, 0.2]) / np.sqrt(0.63)


def landing(folder, tilt):
    """A can on a ball latch, 0.3 um above a plate and tilted by some 1e-7 rad, turns onto its rim and breaks the latch."""
    above, tilted, place = np.empty(3), np.array([1.0, 0.3 * tilt, 0.4 * tilt, 0.2]), np.empty(4)
    mujoco.mju_rotVecQuat(above, np.array([0.0, 0.0, 0.15 + 3e-7]), ROTATION)
    mujoco.mju_mulQuat(place, ROTATION, tilted / np.linalg.norm(tilted))
    joints = {"robot/free": [*POSITION, *ROTATION], "can/free": [*(POSITION + above), *place]}
    when = {"within": {"position_m": 5.0}}
    grasp = {"robot_site": "grip", "object_site": "handle", "joint": "ball", "when": when, "load_limit": {"force_N": 3.0}}
    return scene(
        folder,
        PLATE,
        {"can": CAN},
        duration_s=0.005,
        initial={"joints": joints, "rates": {"can/free": [0.0, 0.0, 0.0, 0.3, -2.0, 0.1]}},
        contacts={"rules": [{"between": ["plate", "can/can"], "restitution": 0.0}]},
        grasps={"grasp": grasp},
        phases=[{"name": "land", "until": "end", "arm": ["grasp"], "controller": OFF}],
    )


@pytest.mark.long(one_of=3)
@pytest.mark.parametrize("tilt", [1e-7, 5e-7, 7e-7])
def test_forces_on_a_rim_agree_to_what_the_state_determines(tmp_path, tilt):
    """The tilt is some 1e-6 rad, the rounding of a transfer 1e-15 rad: forces agree to 1e-9, and not to 1e-10."""
    run = ffsm_mj.run(landing(tmp_path, tilt))
    assert [len(run.records[kind]) for kind in ("contact_beginnings", "releases")] == [1, 1]
    assert run.records["contact_beginnings"][0].force_after_N > 1000.0
    assert [str(check) for check in all_checks(run) if not check.passes] == []
    assert [each for each in replay_log(run.log).worst.values() if not each.passes] == []


@pytest.mark.parametrize(("kind", "field"), [("contact_beginnings", "force_after_N"), ("releases", "force_N")])
def test_a_force_that_is_wrong_by_a_millionth_is_found(tmp_path, kind, field):
    log = ffsm_mj.run(landing(tmp_path, 5e-7)).log
    (record,) = log.records[kind]
    wrong = replace(record, **{field: getattr(record, field) * (1.0 + 1e-6)})
    changed = with_records(log, {kind: [wrong]})
    assert [each.what for each in replay_log(changed).worst.values() if not each.passes]
