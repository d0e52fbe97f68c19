"""The shipped scenario ``nozzle-capture``: facets of a mesh that is not convex lead a probe, friction of pins holds."""

from __future__ import annotations

import runpy

import mujoco
import numpy as np
import pytest

import ffsm_mj
from ffsm_mj._core.polytopes import normals_at
from ffsm_mj.assembly.prepare import prepare
from ffsm_mj.scenario.shipped import scenarios_dir
from tests.replays import proved

MESH = runpy.run_path(str(scenarios_dir().parent / "docs" / "nozzle_mesh.py"))
REST_S = 3.0


def test_the_model_has_the_mesh_of_its_script():
    spec = mujoco.MjSpec.from_file(str(scenarios_dir().parent / "mjcf" / "spent_stage.xml"))
    vertices, faces = MESH["nozzle"]()
    assert np.array_equal(np.array(spec.mesh("nozzle").uservert).reshape(-1, 3), vertices.astype(np.float32))
    assert np.array_equal(np.array(spec.mesh("nozzle").userface).reshape(-1, 3), faces)


def test_the_pieces_fill_the_nozzle_and_leave_its_inside_free():
    """Volume of a solid in facets by its profile; no piece has a point of the axis."""
    system = prepare("nozzle-capture").system
    pieces = system.pieces[system.index("geom", "stage/nozzle")]
    x, radius = np.array(MESH["INNER"] + MESH["OUTER"]).T
    following, sectors = np.roll(np.arange(len(x)), -1), MESH["SECTORS"]
    # Frusta with twelve sides: area of a polygon sectors / 2 sin(2 pi / sectors) r^2, squares of a linear radius integrated.
    squares = (radius**2 + radius * radius[following] + radius[following] ** 2) / 3.0
    volume = abs(float(((x[following] - x) * squares).sum())) * sectors / 2.0 * np.sin(2.0 * np.pi / sectors)
    assert sum(piece.volume for piece in pieces) == pytest.approx(volume, rel=1e-12)
    geom, axis = system.index("geom", "stage/nozzle"), np.empty(9)
    mujoco.mju_quat2Mat(axis, system.mj.geom_quat[geom])
    start = np.array([-1.6, 0.0, 0.0]) - system.mj.geom_pos[geom]
    for along in np.linspace(0.0, 0.7, 15):
        point = axis.reshape(3, 3).T @ (start + along * np.eye(3)[0])
        assert all(normals_at(piece, point, 0.0) is None for piece in pieces)


def facet_normals():
    """Normals of the facets between the bell and the throat, into the nozzle, in its axes, (sectors, 3)."""
    (x0, r0), (x1, r1) = MESH["INNER"][1:3]
    around = 2.0 * np.pi * np.arange(MESH["SECTORS"]) / MESH["SECTORS"]
    rise = (r0 - r1) * np.cos(np.pi / MESH["SECTORS"])
    normals = np.stack((np.full(len(around), -rise), -(x1 - x0) * np.cos(around), -(x1 - x0) * np.sin(around)), axis=1)
    return normals / np.linalg.norm(normals, axis=1)[:, None]


@pytest.mark.long
def test_the_facets_lead_the_probe_and_friction_holds():
    run = proved(ffsm_mj.run("nozzle-capture"))
    assert [(phase.name, phase.reason) for phase in run.phases] == [
        ("enter", "start"),
        ("expand", "depth"),
        ("hold", "time"),
    ]
    assert run.unhandled_contacts == ()
    model = prepare("nozzle-capture").system.mj
    data = mujoco.MjData(model)
    stage, head = model.body("stage/stage").id, model.site("robot/head").id
    places, attitudes = [], []
    for row in run.qpos:
        data.qpos[:] = row
        mujoco.mj_kinematics(model, data)
        attitudes.append(data.xmat[stage].reshape(3, 3).copy())
        places.append(attitudes[-1].T @ (data.site_xpos[head] - data.xpos[stage]))
    # The head first meets a facet of the bell, which its hull would have covered: normals point to the stage.
    first = run.impacts[0]
    assert first.geoms == ("robot/head", "stage/nozzle")
    turn = attitudes[int(np.searchsorted(run.time, first.time_s))]
    # The attitude is that of the next row, 10 ms later, at 4 mrad/s.
    assert (facet_normals() @ turn.T @ -np.array(first.normal)).max() == pytest.approx(1.0, abs=1e-8)
    # Held: all three stick, and the head stays where it is in the axes of the stage, to rounding of coordinates of 3 m.
    still = run.time > run.time[-1] - REST_S
    assert np.ptp(np.array(places)[still], axis=0).max() < 1e-13
    for pin in ("pin_1", "pin_2", "pin_3"):
        assert run[f"contact.{pin}_friction_use"][still].max() < 0.5
        assert run[f"contact.{pin}_force_N"][-1] == pytest.approx(23.0, abs=1.0)
