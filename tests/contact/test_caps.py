"""A box on the cap of a cylinder: contact points are its own corners and edges, up to the rim of the cap."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

from ffsm_mj._core.polygons import opposite, touching_set
from ffsm_mj.contact.patch import facing
from ffsm_mj.contact.shape import Shape

RADIUS, HALF = 0.2, 0.1
UP = np.array([0.0, 0.0, 1.0])
BETWEEN = np.pi / 8.0  # midway between two of the eight points that stand for the rim, where their hull reaches to 0.185 m


def on_cap(size, quat, place):
    """Shapes of the cylinder, and of a box whose lowest point is on the cap when its centre is at ``place``."""
    model = mujoco.MjModel.from_xml_string(
        f"""<mujoco><worldbody><geom type="cylinder" size="{RADIUS} {HALF}"/>
        <body pos="{" ".join(map(str, place))}" quat="{" ".join(map(str, quat))}"><freejoint/><inertial pos="0 0 0" mass="1"
        diaginertia="1 1 1"/><geom type="box" size="{" ".join(map(str, size))}"/></body></worldbody></mujoco>"""
    )
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    return Shape(model, data, 0), Shape(model, data, 1)


def sorted_rows(points):
    return np.array(sorted(points.round(12).tolist()))


@pytest.mark.parametrize("reach", [0.195, 0.25])
@pytest.mark.parametrize("swapped", [False, True])
def test_an_edge_on_a_cap_touches_up_to_its_end_or_to_the_rim(reach, swapped):
    half = 0.1
    end = reach * np.array([np.cos(BETWEEN), np.sin(BETWEEN)])
    quat = (np.cos(np.pi / 8.0), np.sin(np.pi / 8.0), 0.0, 0.0)  # its edge along x is lowest
    cylinder, box = on_cap((half, 0.05, 0.05), quat, (end[0] - half, end[1], HALF + 0.05 * np.sqrt(2.0)))
    first, second, up = (box, cylinder, -UP) if swapped else (cylinder, box, UP)
    last = min(end[0], np.sqrt(RADIUS**2 - end[1] ** 2))
    expected = [[end[0] - 2.0 * half, end[1], HALF], [last, end[1], HALF]]
    found = touching_set(*facing(first, second, up), up)
    assert sorted_rows(found) == pytest.approx(sorted_rows(np.array(expected)), abs=1e-12)


def test_a_corner_near_the_rim_is_opposite_the_cap():
    """A corner 0.195 m from the axis is in contact; one at 0.205 m is not."""
    turn = np.array([np.cos(0.3), np.sin(0.3) / np.sqrt(2.0), np.sin(0.3) / np.sqrt(2.0), 0.0])
    rotation = np.empty(9)
    mujoco.mju_quat2Mat(rotation, turn)
    corners = np.array([[x, y, z] for x in (-0.05, 0.05) for y in (-0.05, 0.05) for z in (-0.05, 0.05)])
    lowest = min((corners @ rotation.reshape(3, 3).T).tolist(), key=lambda corner: corner[2])
    for reach, touches in ((0.195, True), (0.205, False)):
        corner = np.array([reach * np.cos(BETWEEN), reach * np.sin(BETWEEN), HALF])
        cylinder, box = on_cap((0.05, 0.05, 0.05), turn, corner - lowest)
        assert opposite(*facing(cylinder, box, UP), UP) is touches
