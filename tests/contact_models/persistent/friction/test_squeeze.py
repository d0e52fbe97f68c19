"""The shipped scenario ``squeeze``: held by friction at half its limit, slides off above it."""

from __future__ import annotations

import json
import math

import mujoco
import numpy as np
import pytest
from ruamel.yaml import YAML

import ffsm_mj
from ffsm_mj.scenario.shipped import scenarios_dir
from tests.contact_models.persistent.friction.scenes import load, loaded, slips
from tests.replays import assert_passes, proved
from tests.scenes import ball, compile_paths

MU, GRIP_N, CUBE_KG = 0.3, 15.0, 5.0
CUBE_KG_M2 = CUBE_KG * 0.2**2 / 6
GRIP_X_M = 0.45 + 2 * 0.5 * math.cos(0.4) + 0.27
MASS_CENTRES = {
    "bus": (50.0, (0, 0, 0)),
    "upper_arm": (3.0, (0.25, 0, 0)),
    "fore_arm": (2.0, (0.25, 0, 0)),
    "hand": (1.4, (0.06, 0, 0)),
    "left_finger": (0.3, (-0.05, 0, 0)),
    "right_finger": (0.3, (-0.05, 0, 0)),
}
"""Mass in kg and place in m of each body of the robot."""


def pulled_away(folder, rate):
    """Outside forces give robot and gripper the acceleration ``rate`` t and carry what friction asks of the pads."""
    scenario = YAML(typ="safe").load(scenarios_dir() / "squeeze.yaml")
    mjcf = scenarios_dir().parent / "mjcf"
    scenario["robot"]["mjcf"] = str(mjcf / "servicer_gripper.xml")
    (folder / "anchor.xml").write_text(ball("anchor").replace('<freejoint name="free"/>', ""))
    anchor = {"mjcf": "anchor.xml", "fixed": True, "pose": {"position_m": [9, 9, 9]}}
    scenario["objects"] = {"cube": {"mjcf": str(mjcf / "cube_5kg.xml")}, "anchor": anchor}
    scenario["initial"] = {
        "joints": scenario["initial"]["joints"] | {"left": 0.025, "right": 0.025, "cube/free": [GRIP_X_M, 0, 0, 1, 0, 0, 0]}
    }
    grip = next(phase for phase in scenario["phases"] if phase["name"] == "grip")
    scenario["phases"] = [{"name": "grip", "until": "end", "controllers": grip["controllers"]}]
    growing = [
        load(f"robot/{body}", "anchor/anchor", force_N=[[0, 0, 0], [mass * rate, 0, 0]], at_m=place)
        for body, (mass, place) in MASS_CENTRES.items()
    ] + [
        load(f"robot/{side}_finger", "anchor/anchor", force_N=[[0, 0, 0], [CUBE_KG * rate / 2, 0, 0]], at_m=[0, y, 0])
        for side, y in (("left", -0.025), ("right", 0.025))
    ]
    path = folder / "scene.yaml"
    path.write_text(json.dumps(scenario | {"contact_models": loaded(*growing), "duration_s": 0.056}))
    return path


def test_the_grip_slips_where_the_load_exceeds_the_friction_of_both_pads(tmp_path):
    """Without rotation the cube of 5 kg needs 5 kg times 35 t m/s^2 of 2 mu N = 9 N: until 9 / 175 s, inside a step."""
    run = proved(ffsm_mj.run(pulled_away(tmp_path, 35.0)), records=False)
    assert slips(run) == [pytest.approx(2 * MU * GRIP_N / (CUBE_KG * 35.0), rel=1e-6)] * 2


def shares_of_corners(run, rows):
    """Force and moment about its centre of the pads on the cube at some rows, N and N m, world axes, (r, 3) each.

    From the logged states and normal forces alone: equal springs give each corner of a pad a quarter of its normal force,
    and friction acts against the slip there.
    """
    mjcf = scenarios_dir().parent / "mjcf"
    model = compile_paths(mjcf / "servicer_gripper.xml", {"cube": mjcf / "cube_5kg.xml"}).mj
    data = mujoco.MjData(model)
    cube = model.body("cube/cube").id
    states = [np.stack([run[key] for key in run.keys if key.startswith(f"state.{which}_")], axis=1) for which in "qv"]
    found = []
    for row in rows:
        data.qpos[:], data.qvel[:] = (each[row] for each in states)
        mujoco.mj_forward(model, data)
        total = np.zeros((2, 3))
        for side, inwards in (("left", -1.0), ("right", 1.0)):
            pad = model.geom(f"robot/{side}_pad")
            axes = data.geom_xmat[pad.id].reshape(3, 3)
            normal = inwards * axes[:, 1]
            pushed = np.array([run[f"contact.{side}_force_{axis}_N"][row] for axis in "xyz"]) @ normal / 4.0
            for x, z in ((x, z) for x in (-1.0, 1.0) for z in (-1.0, 1.0)):
                place = data.geom_xpos[pad.id] + axes @ (pad.size * (x, inwards, z))
                slip = velocity_of(model, data, cube, place) - velocity_of(model, data, int(pad.bodyid[0]), place)
                slip -= normal * (normal @ slip)
                force = pushed * (normal - MU * slip / np.linalg.norm(slip))
                total += force, np.cross(place - data.xpos[cube], force)
        found.append(total)
    return np.moveaxis(np.array(found), 1, 0)


def velocity_of(model, data, body, place):
    """Velocity of the material point of a body at a place, m/s, world axes, (3,)."""
    J = np.empty((3, model.nv))
    mujoco.mj_jac(model, data, J, None, place, body)
    return J @ data.qvel


def simpson(values, dt):
    """Integrals over the two ticks around each row but the ends, (r - 2, 3)."""
    return dt / 3.0 * (values[:-2] + 4.0 * values[1:-1] + values[2:])


@pytest.mark.long
def test_squeeze():
    """The cube comes to rest in the pads, is moved at half of what friction can, and slides off them completely."""
    run = ffsm_mj.run("squeeze")
    assert_passes(run)
    phases = {record.name: record.start_s for record in run.records["phases"]}
    (begins,) = {record.time_s for record in run.records["contact_sticks"]}
    assert phases["grip"] < begins < phases["retract"]
    (slides_s,) = set(slips(run))
    lost_s = [record.time_s for record in run.records["contact_endings"]]
    assert phases["snatch"] < slides_s < min(lost_s)
    assert lost_s == [pytest.approx(lost_s[0], abs=1e-6)] * 2
    force = sum(np.stack([run[f"contact.{side}_friction_{axis}_N"] for axis in "xyz"], axis=1) for side in ("left", "right"))
    # The force that the pads need over 2 mu N, the limit of translation: half of it while the arm retracts.
    used = np.linalg.norm(force, axis=1) / (2 * MU * GRIP_N)
    retracts = (run.time > phases["retract"]) & (run.time < phases["snatch"])
    assert used[retracts].max() == pytest.approx(0.5, abs=0.03)
    # Once lost, nothing acts on the cube.
    free = np.flatnonzero(run.time > lost_s[0])
    assert len(free) > 3
    for component in ("vx_m_s", "vy_m_s", "vz_m_s", "wx_rad_s", "wy_rad_s", "wz_rad_s"):
        assert np.ptp(run[f"state.v_cube_free_{component}"][free]) < 1e-12
    obeys_newton_and_euler(run, slides_s, run.records["contact_changes"][0].time_s)


def obeys_newton_and_euler(run, slides_s, changes_s):
    """Momenta of the logged cube change by forces and moments of the pads, while all four corners of both slide on it."""
    rows = np.flatnonzero((run.time > slides_s + 0.05) & (run.time < changes_s))
    forces, moments = shares_of_corners(run, rows)
    logged = sum(
        np.stack([run[f"contact.{side}_force_{axis}_N"][rows] for axis in "xyz"], axis=1) for side in ("left", "right")
    )
    # The log's forces at rows are those of its states, to the truncation of a step; see the check of forces in analyze.
    np.testing.assert_allclose(forces, logged, atol=1e-6)
    velocity, spin = (
        np.stack([run[f"state.v_cube_free_{kind}{axis}_{unit}"][rows] for axis in "xyz"], axis=1)
        for kind, unit in (("v", "m_s"), ("w", "rad_s"))
    )
    dt = run.time[1] - run.time[0]
    # Efforts are held for a tick, so the slip u of a corner changes evenly in it, by a share r: its direction has a second
    # derivative of at most 2 (r / dt)^2, which the values at ticks do not show, and the integral over two ticks errs by
    # dt^3 / 6 of that of the force. Corners slip at least as fast as the centre less what turns them, half of the fastest.
    speed = run["contact.left_slip_m_s"][rows]
    shares = 2.0 * np.abs(speed[2:] - speed[:-2]) / speed[:-2]
    bound = (dt / 6.0 * 2.0 * (shares / 2.0) ** 2)[:, None]
    limit_N, arm_m = 2 * MU * GRIP_N, 0.04 * math.sqrt(2.0)
    by_forces, by_moments = simpson(forces, dt), simpson(moments, dt)
    assert np.all(np.abs(CUBE_KG * (velocity[2:] - velocity[:-2]) - by_forces) <= limit_N * bound)
    assert np.all(np.abs(CUBE_KG_M2 * (spin[2:] - spin[:-2]) - by_moments) <= limit_N * arm_m * bound)
    # Over the whole slide these errors do not add up to a thousandth.
    ends = slice(0, len(rows) // 2 * 2 - 1, 2)
    whole = velocity[2:][ends][-1] - velocity[0]
    assert CUBE_KG * whole == pytest.approx(by_forces[ends].sum(axis=0), abs=1e-3 * np.abs(by_forces[ends].sum()))
    turned = spin[2:][ends][-1] - spin[0]
    assert CUBE_KG_M2 * turned == pytest.approx(by_moments[ends].sum(axis=0), abs=1e-3 * np.abs(by_moments[ends].sum()))
    # Not nothing: friction turns the cube.
    assert np.abs(moments[:, 1]).max() > 0.01
