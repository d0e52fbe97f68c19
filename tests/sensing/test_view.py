"""Field of view and occlusion: closed-form geometry of a camera, a target and a wall between them."""

from __future__ import annotations

import math
from types import SimpleNamespace

import mujoco
import pytest

from ffsm_mj.sensing.config import FieldOfViewConfig
from ffsm_mj.sensing.view import FieldOfView

EYE = (0.3, -0.2, 0.1)


def shows(target, *, axis="z", half=0.5, turn="1 0 0 0", wall="5 5 5", occlusion=True):
    """Whether a point on a ball of 0.05 m is seen from an eye in a small box; the wall is a cube of 0.2 m."""
    at = " ".join(str(a + b) for a, b in zip(EYE, target, strict=True))
    model = mujoco.MjModel.from_xml_string(f"""<mujoco><worldbody>
      <body name="eye" pos="{EYE[0]} {EYE[1]} {EYE[2]}" quat="{turn}"><freejoint/><geom type="box" size=".1 .1 .1"/>
        <site name="apex"/></body>
      <body name="ball" pos="{at}"><freejoint/><geom type="sphere" size=".05"/></body>
      <body name="wall" pos="{wall}"><freejoint/><geom type="box" size=".1 .1 .1"/></body></worldbody>
      <sensor><framepos name="camera" objtype="xbody" objname="ball" reftype="site" refname="apex"/></sensor></mujoco>""")
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    config = FieldOfViewConfig(half_angle_rad=half, site="apex", axis=axis)
    sensor = SimpleNamespace(name="camera", field_of_view=config, occlusion=occlusion)
    return FieldOfView(model, sensor, "apex").shows(data)


@pytest.mark.parametrize("axis", ["x", "y", "z", "-x", "-y", "-z"])
def test_the_edge_of_the_cone_about_each_axis(axis):
    """A target at an angle of 0.5 rad less or more than 1e-9 from the axis; on the other side it is never seen."""
    i, sign = "xyz".index(axis[-1]), -1.0 if axis[0] == "-" else 1.0

    def at(angle):
        target = [0.0, 0.0, 0.0]
        target[i], target[(i + 1) % 3] = 2.0 * sign * math.cos(angle), 2.0 * math.sin(angle)
        return target

    assert shows(at(0.5 - 1e-9), axis=axis)
    assert not shows(at(0.5 + 1e-9), axis=axis)
    assert not shows(at(math.pi), axis=axis)
    assert shows(at(math.pi - 0.1), axis=axis, half=math.pi)


def test_the_cone_turns_with_its_site():
    """Turned by 90 deg about x, the site's z axis is the world's -y axis."""
    half_turn = f"{math.sqrt(0.5)} {math.sqrt(0.5)} 0 0"
    assert shows((0.0, -2.0, 0.0), turn=half_turn)
    assert not shows((0.0, 0.0, 2.0), turn=half_turn)


# The line of sight is along z through (0.3, -0.2); the wall reaches 0.1 m about its centre.
@pytest.mark.parametrize(
    ("wall", "seen"),
    [
        ("0.3 -0.2 1.1", False),
        ("0.399 -0.2 1.1", False),
        ("0.401 -0.2 1.1", True),
        ("0.3 -0.2 2.5", True),
        ("0.3 -0.2 -1", True),
    ],
    ids=["between", "at its edge", "past its edge", "behind the target", "behind the eye"],
)
def test_a_wall_hides_what_is_behind_it(wall, seen):
    """The eye's own box and the ball around the target hide nothing."""
    assert shows((0.0, 0.0, 2.0), wall=wall) is seen
    assert shows((0.0, 0.0, 2.0), wall=wall, occlusion=False)
