"""The cap of a cylinder on a box: where its rim crosses an edge, and its nearest point between the fixed points."""

from __future__ import annotations

import math

import mujoco
import numpy as np
import pytest

import ffsm_mj
from ffsm_mj.assembly.prepare import prepare
from ffsm_mj.contact.features.body_motion import BodyMotion, dot, shifted, unit
from ffsm_mj.contact.features.cores import Circle
from ffsm_mj.contact.features.search import features
from tests.contact_models.impact.test_fixed import slab
from tests.replays import proved
from tests.scenes import HEAD, scene

_RADIUS, _HALF, _OVER = 0.12, 0.15, 0.05
_TURN = math.radians(11.0)
"""About the cylinder's axis: none of the fixed points of the cap is where the rim crosses the edge."""
_FLAT = {"position_m": [0, 0, -0.5]}
_ON_EDGE = {"position_m": [0, 0, -0.5 * math.sqrt(2.0)], "quaternion": [math.cos(math.pi / 8), 0, math.sin(math.pi / 8), 0]}


def drum(folder, rates, floor, *, restitution=0.0, tilt=0.0, **more):
    """A scene with a cylinder that stands at x = _OVER on the top of a box, or on its edge along y, with given rates."""
    model = f"""<mujoco>{HEAD}<worldbody><body name="b"><freejoint name="free"/>
      <inertial pos="0.01 0.02 0.03" mass="1" diaginertia="0.012 0.010 0.007"/>
      <geom name="g" type="cylinder" size="{_RADIUS} {_HALF}" mass="0"/></body></worldbody></mujoco>"""
    about_y = np.array([math.cos(tilt / 2), 0.0, math.sin(tilt / 2), 0.0])
    about_z, pose = np.array([math.cos(_TURN / 2), 0.0, 0.0, math.sin(_TURN / 2)]), np.zeros(4)
    mujoco.mju_mulQuat(pose, about_y, about_z)
    return scene(
        folder,
        model,
        {"floor": slab("floor", "0.5 0.5 0.5")},
        fixed={"floor": floor},
        initial={
            "joints": {"robot/free": [_OVER, 0, _HALF, *pose.tolist()]},
            "rates": {"robot/free": list(rates)},
        },
        contacts={"rules": [{"between": ["robot/g", "floor/floor"], "restitution": restitution}]},
        **more,
    )


def test_where_a_rim_crosses_an_edge(tmp_path):
    """The crossing is on the circle, not on the polygon of the fixed points, which is up to 8 % of the radius further in."""
    assembly = prepare(drum(tmp_path, [0.0] * 6, _ON_EDGE)).assemble()
    points = assembly.pairs[0].proximity(assembly.system.mj, assembly.data).points
    half = math.sqrt(_RADIUS**2 - _OVER**2)
    np.testing.assert_allclose(
        sorted(points[:, 1]), [-half, half], atol=1e-9
    )  # the points of a level face are merged in 1e-9


def test_the_fastest_point_of_a_rim_is_a_contact_point(tmp_path):
    """It is between two fixed points; without it an impact leaves the rim approaching, and it sinks 6e-5 m into a wall."""
    rates = [0.0, 0.0, -0.2, 0.7, -0.45, 0.3]
    path = drum(tmp_path, rates, _FLAT, restitution=0.4, duration_s=0.05)
    assembly = prepare(path).assemble()
    near = assembly.pairs[0].proximity(assembly.system.mj, assembly.data)
    assert near.rate == pytest.approx(-0.2 - _RADIUS * math.hypot(0.7, 0.45), abs=1e-12)
    run = ffsm_mj.run(path)
    assert run.impacts
    proved(run)


def test_the_second_rate_where_a_rim_crosses_an_edge(tmp_path):
    """Equal to that of the gap function of the feature: exact although the cap is flat on the edge to 5e-7 rad only."""
    rates = [0.05, -0.08, 0.0, 0.4, 0.3, -0.2]
    assembly = prepare(drum(tmp_path, rates, _ON_EDGE, tilt=5e-7)).assemble()
    (pair,), model, data = assembly.pairs, assembly.system.mj, assembly.data
    near = pair.proximity(model, data)
    crossing = [found.at(data) for found in features(pair, model, data, near) if found.name == "edge on rim"]
    assert crossing
    for state in crossing:
        point = min(near.points, key=lambda each, at=state.point: math.dist(each, at))
        jacobian, turning = np.empty((3, model.nv)), np.empty((3, model.nv))
        mujoco.mj_jac(model, data, jacobian, None, state.point_a, pair.body_a)
        mujoco.mj_jacDot(model, data, turning, None, state.point_a, pair.body_a)
        acceleration = jacobian @ data.qacc + turning @ data.qvel
        rate = pair.second_rate(model, data, near, point)
        # The two places differ by what the tilt lifts, 5e-7 rad over the point's offset of 0.05 m from the tilt's axis.
        assert rate.value == pytest.approx(state.bend - state.normal @ acceleration, abs=1e-7 * rate.scale)


@pytest.mark.parametrize("tilt", [1e-5, 1e-8, 1e-11])
def test_the_lowest_point_of_a_rim_is_in_its_plane_at_any_tilt(tilt):
    """Rounding over the tilt, 1e-8 of the radius here, lifted it off the plane: gaps of rims on faces were as wrong."""
    axis, start = (0.48, 0.6, 0.64), (0.8, 0.0, -0.6)
    still = BodyMotion((0.0, 0.0, 0.0), np.eye(3).ravel().tolist(), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0))
    rim = Circle("rim", None, (0.0, 0.0, 0.0), unit(axis), unit(start), _RADIUS)
    point = rim.extreme(still, unit(shifted(rim.axis, tilt, rim.start)))
    assert abs(dot(point, rim.axis)) < 1e-16
    assert math.hypot(*point) == pytest.approx(_RADIUS, rel=1e-15)
