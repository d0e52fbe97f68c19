"""The view that is chosen: the contact, the tip and the base are seen in it; the scenario's own goes before it."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

import ffsm_mj
from ffsm_mj.errors import InputError
from ffsm_mj.log.camera import USUAL, SeenScene, aimed, directions, framed_points
from ffsm_mj.log.drawing import geoms_to_draw, marker_scale
from ffsm_mj.log.rerun.layout import WIDE_VIEW
from ffsm_mj.log.scenario import compile_log
from tests.log.test_recording_layout import layout  # noqa: F401
from tests.scenes import ARM, HEAD, compile_paths, two_balls

TIP_M = (1.3, 0.0, 0.0)
"""Where the outstretched arm of ``ARM`` ends."""


def posed(folder, *, place, half, colour="", contacts=()):
    """What is seen of the arm at its zero position beside a box, and the points to keep in view."""
    (folder / "robot.xml").write_text(ARM)
    geom = f'<geom type="box" size="{half[0]} {half[1]} {half[2]}" mass="1" {colour}/>'
    body = f'<body name="wall" pos="{place[0]} {place[1]} {place[2]}"><freejoint/>{geom}</body>'
    (folder / "wall.xml").write_text(f"<mujoco>{HEAD}<worldbody>{body}</worldbody></mujoco>")
    system = compile_paths(folder / "robot.xml", {"wall": folder / "wall.xml"})
    data = mujoco.MjData(system.mj)
    mujoco.mj_kinematics(system.mj, data)
    points = framed_points(system, data.xpos, data.xquat)
    return SeenScene(system, data.xpos, data.xquat, np.array(contacts).reshape(-1, 3)), points


def crosses_box(eye, point, centre, half):
    """Whether the segment from one point to another meets a box along the axes: slabs in closed form."""
    along = np.where(point == eye, 1e-300, point - eye)
    ends = np.sort([(centre - half - eye) / along, (centre + half - eye) / along], axis=0)
    return bool(max(ends[0].max(), 0.0) < min(ends[1].min(), 1.0))


BESIDE = {"place": (2.5, 0.0, 0.0), "half": (0.5, 0.5, 0.5)}
"""A box that hides nothing."""
WALL, HALF = np.array([0.8, -0.6, 0.5]), np.array([0.9, 0.05, 0.6])


def test_a_wall_before_the_contact_is_looked_around(tmp_path):
    """A wall of 1.8 m stands between the usual camera and the tip; the ray of the chosen one does not cross it."""
    seen, points = posed(tmp_path, place=WALL, half=HALF, contacts=[TIP_M])
    back = seen.best(points, WIDE_VIEW)
    for way, hidden in ((USUAL, True), (back, False)):
        eye, _ = aimed(points, way, WIDE_VIEW)
        assert crosses_box(eye, np.array(TIP_M), WALL, HALF) == hidden
        assert (seen.contact_seen(eye) < 0.5) == hidden


def test_the_usual_view_is_kept_where_it_hides_nothing(tmp_path):
    seen, points = posed(tmp_path, **BESIDE, contacts=[TIP_M])
    np.testing.assert_array_equal(seen.best(points, WIDE_VIEW), USUAL)


def test_what_is_transparent_hides_nothing(tmp_path):
    """All points of the hull are seen through the wall, of which a solid one hides some."""
    for opacity, all_seen in ((0.2, True), (1.0, False)):
        seen, points = posed(tmp_path, place=WALL, half=HALF, colour=f'rgba="1 1 1 {opacity}"')
        eye, _ = aimed(points, USUAL, WIDE_VIEW)
        assert (seen.body_seen(eye, seen._system.robot.root) > 0.9) == all_seen


def test_the_tip_is_the_body_at_the_contact(tmp_path):
    """Without a contact it is the last one of the chain."""
    for contacts, body in (([TIP_M], "lower"), ([], "finger"), ([(0.5, 0.03, 0.0)], "upper")):
        seen, _ = posed(tmp_path, **BESIDE, contacts=contacts)
        assert seen._system.mj.body(seen.tip).name == f"robot/{body}"


def test_directions_are_unit_vectors_from_above():
    ways = directions()
    np.testing.assert_allclose(np.linalg.norm(ways, axis=1), 1.0, rtol=1e-15)
    assert (ways[:, 2] > 0.3).all()
    assert len(np.unique(ways.round(6), axis=0)) == len(ways)


def free_sight(run, half_view):
    """Least part, of all first contact points, of the way from the camera that no other body is in, in near distances.

    Rays through MuJoCo's own kinematics at the first mark, one by one, with geoms that are not drawn passed over.
    """
    system, marks = compile_log(run.log), sorted(run.log.marks(), key=lambda mark: mark[1])
    at = marks[0][1]
    contacts = np.array([mark.point_m for _, time, mark in marks if time == at])
    # The sites of a grasp may be inside bodies; where they touch too, it is the point of their impact that counts.
    judged = np.array([mark.point_m for kind, time, mark in marks if time == at and kind.name == "impact"] or contacts)
    data = mujoco.MjData(system.mj)
    data.qpos[:] = run.qpos[min(int(np.searchsorted(run.time, at - 1e-9)), len(run.time) - 1)]
    mujoco.mj_forward(system.mj, data)
    points = framed_points(system, data.xpos, data.xquat)
    eye, _ = aimed(points, SeenScene(system, data.xpos, data.xquat, contacts).best(points, half_view), half_view)
    drawn, before = set(geoms_to_draw(system.mj)), []
    for point in judged:
        start, way, geom = eye.copy(), (point - eye) / np.linalg.norm(point - eye), np.zeros(1, dtype=np.int32)
        while (far := mujoco.mj_ray(system.mj, data, start, way, None, True, -1, geom)) >= 0.0 and geom[0] not in drawn:
            start += (far + 1e-6) * way
        hit = start + far * way if far >= 0.0 else point
        before.append(max(0.0, float((point - hit) @ way)))
    return max(before) / (0.3 * marker_scale(system))


def test_the_first_contact_of_the_baseline_is_seen(baseline):
    """Nothing is in front of it but the bodies that touch there: their surfaces are nearer than 0.15 m to it."""
    assert free_sight(baseline, WIDE_VIEW) < 0.5


@pytest.mark.long(one_of=4)
@pytest.mark.parametrize(
    "name",
    [
        "push",
        "spatial",
        "capture",
        "berth",
        "probe-and-cone",
        "capture-planar",
        "squeeze",
        "gripper-2f85",
        "capture-flexible",
        "tap",
    ],
)
def test_first_contacts_of_shipped_scenarios_are_seen(name):
    assert free_sight(ffsm_mj.run(name), WIDE_VIEW) < 0.5


@pytest.mark.parametrize(("view", "back"), [([0, -2, 2], [0.0, -(0.5**0.5), 0.5**0.5]), ([0, 0, 1], [0.0, -0.02, 1.0])])
def test_the_view_of_a_scenario_is_that_of_its_recording(layout, tmp_path, ffsm_run, view, back):  # noqa: F811
    """From a direction of any length; one that is vertical is tilted, so that the camera knows what is up."""
    eye = layout(ffsm_run(two_balls(tmp_path, view=view))).root_container.contents[0].contents[0].properties["EyeControls3D"]
    place, target = (np.array(part.as_arrow_array().to_pylist()[0]) for part in (eye.position, eye.look_target))
    # Rerun has them in single precision, some 1e-7 of a distance of the order of the scene.
    np.testing.assert_allclose(
        (place - target) / np.linalg.norm(place - target), np.divide(back, np.linalg.norm(back)), atol=1e-5
    )


def test_a_view_that_is_no_direction_is_refused(tmp_path):
    with pytest.raises(InputError, match=r"scene.yaml:1:\d+: view: .*a direction is needed"):
        ffsm_mj.run(two_balls(tmp_path, view=[0, 0, 0]))
