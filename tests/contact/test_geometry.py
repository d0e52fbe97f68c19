"""All 28 pairs of seven convex shapes in contact: gap, normal and point against closed forms of the shapes."""

from __future__ import annotations

from itertools import combinations_with_replacement

import mujoco
import numpy as np
import pytest

from ffsm_mj._core.polygons import touching_set
from ffsm_mj._core.shapes import separation
from ffsm_mj.assembly.prepare import prepare
from ffsm_mj.contact.normal import NormalSearch, SphereNormal, refine_normal
from ffsm_mj.contact.shape import Shape
from ffsm_mj.errors import InputError
from ffsm_mj.tolerances import PARALLEL
from tests.scenes import HEAD, ball, box, scene

_hull = np.random.default_rng(5).normal(size=(14, 3))
MESHES = {
    "tetra": "0.2 0 -0.1  -0.1 0.18 -0.1  -0.1 -0.18 -0.1  0 0 0.25",
    "hull": " ".join(f"{x:.6f}" for x in (0.2 * _hull / np.linalg.norm(_hull, axis=1)[:, None]).ravel()),
}
SHAPES = {
    "sphere": 'type="sphere" size="0.15"',
    "capsule": 'type="capsule" size="0.08 0.15"',
    "ellipsoid": 'type="ellipsoid" size="0.1 0.2 0.15"',
    "cylinder": 'type="cylinder" size="0.12 0.15"',
    "box": 'type="box" size="0.1 0.15 0.2"',
    "tetra": 'type="mesh" mesh="tetra"',
    "hull": 'type="mesh" mesh="hull"',
}
PAIRS = list(combinations_with_replacement(SHAPES, 2))


def shape(name):
    asset = f'<asset><mesh name="{name}" vertex="{MESHES[name]}"/></asset>' if name in MESHES else ""
    return f"""<mujoco>{HEAD}{asset}<worldbody><body name="b"><freejoint name="free"/>
      <inertial pos="0 0 0" mass="1" diaginertia="0.1 0.1 0.1"/><geom name="g" {SHAPES[name]} mass="0"/>
      </body></worldbody></mujoco>"""


def support(name, model, data, geom, direction):
    """Extent of a shape along a world direction, in closed form."""
    rotation, position = data.geom_xmat[geom].reshape(3, 3), data.geom_xpos[geom]
    n = rotation.T @ direction
    if name in MESHES:
        mesh = int(model.geom_dataid[geom])
        first = model.mesh_vertadr[mesh]
        reach = (model.mesh_vert[first : first + model.mesh_vertnum[mesh]] @ n).max()
    else:
        reach = {
            "sphere": 0.15,
            "capsule": 0.08 + 0.15 * abs(n[2]),
            "ellipsoid": np.linalg.norm(np.array([0.1, 0.2, 0.15]) * n),
            "cylinder": 0.12 * np.hypot(n[0], n[1]) + 0.15 * abs(n[2]),
            "box": np.array([0.1, 0.15, 0.2]) @ np.abs(n),
        }[name]
    return position @ direction + reach


def collision(folder, a, b, rng, *, tumbling=True):
    """Impact record and state of two shapes that hit each other in random poses."""

    def quaternion():
        q = rng.normal(size=4)
        return (q / np.linalg.norm(q)).tolist()

    spin = (lambda: rng.uniform(-2, 2, 3).tolist()) if tumbling else (lambda: [0.0, 0.0, 0.0])
    path = scene(
        folder,
        shape(a),
        {"other": shape(b)},
        duration_s=1.2,
        time_step_s=0.01,
        control_period_s=0.01,
        stop_on_impact=True,
        initial={
            "joints": {
                "robot/free": [0, 0, 0, *quaternion()],
                "other/free": [1.0, *rng.uniform(-0.1, 0.1, 2).tolist(), *quaternion()],
            },
            "rates": {"robot/free": [1, 0, 0, *spin()], "other/free": [0, 0, 0, *spin()]},
        },
        contacts={"rules": [{"between": ["robot/g", "other/g"]}]},
    )
    prepared = prepare(path)
    run = prepared.run()
    model = prepared.system.mj
    data = mujoco.MjData(model)
    data.qpos[:] = run.impacts[0].qpos
    mujoco.mj_forward(model, data)
    return run.impacts[0], model, data


@pytest.mark.long(one_of=25)
@pytest.mark.parametrize("draw", [0, *(pytest.param(draw, marks=pytest.mark.long) for draw in (1, 2, 3))])
@pytest.mark.parametrize(("a", "b"), PAIRS)
def test_contact_is_exact_for_every_pair(tmp_path, draw, a, b):
    """Along the normal the closed-form supports meet: gap and normal are optimal, and the point is on both shapes.

    The gap is stationary in the normal, so an error d of the normal appears as R d^2 in the gap, but as R d in the point: if
    a shape has one extreme point along the normal, it must be the contact point. 1e-12 m is the rounding of metres.
    """
    rng = np.random.default_rng([20240601, draw])
    impact, model, data = collision(tmp_path, a, b, rng)
    normal, point = np.array(impact.normal), np.array(impact.point_m)
    sides = []
    for geom, name, direction in ((0, a, normal), (1, b, -normal)):
        reach = support(name, model, data, geom, direction)
        sides.append(reach)
        assert point @ direction == pytest.approx(reach, abs=1e-12)
        own = Shape(model, data, geom).extreme(direction, PARALLEL)
        if len(own) == 1:
            np.testing.assert_allclose(point, own[0], rtol=0, atol=1e-12)
    assert -sides[1] - sides[0] == pytest.approx(0.0, abs=1e-12)
    assert abs(impact.gap_m) < 1e-12
    # It was the first touch: no direction separates the shapes by more.
    for _ in range(20):
        other = normal + rng.normal(scale=1e-3, size=3)
        other /= np.linalg.norm(other)
        gap = -support(b, model, data, 1, -other) - support(a, model, data, 0, other)
        assert gap < 1e-12


def test_shapes_without_an_exact_distance_are_refused_by_name(tmp_path):
    ground = f"""<mujoco>{HEAD}<asset><hfield name="h" nrow="2" ncol="2" size="1 1 1 1"/></asset><worldbody>
      <body name="b"><freejoint/><inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/>
      <geom name="g" type="hfield" hfield="h" mass="0"/></body></worldbody></mujoco>"""
    path = scene(tmp_path, ball(), {"o": ground}, contacts={"rules": [{"between": ["ball", "o/g"]}]})
    with pytest.raises(InputError, match="geom 'o/g' is a height field: impacts need convex geoms"):
        prepare(path)


def square(half, z=0.0, centre=(0.0, 0.0), turn=0.0):
    corners = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) * half
    c, s = np.cos(turn), np.sin(turn)
    return np.column_stack((corners @ np.array([[c, s], [-s, c]]) + centre, np.full(4, z)))


UP = np.array([0.0, 0.0, 1.0])


@pytest.mark.parametrize(
    ("first", "second", "count"),
    [
        (square(1.0), square(0.5), 4),
        (square(1.0), square(1.0, turn=np.pi / 4), 8),
        (square(1.0), square(1.0, centre=(1.5, 0.3)), 4),
        (square(1.0), np.array([[-2.0, 0.2, 0], [2.0, 0.1, 0]]), 2),
        (np.array([[-2.0, 0, 0], [2.0, 0, 0]]), np.array([[0, -1.0, 0], [0.3, 1.0, 0]]), 1),
        (np.array([[-2.0, 0, 0], [2.0, 0, 0]]), np.array([[-3.0, 0, 0], [0.3, 0.0, 0]]), 2),
        (square(1.0), np.array([[0.3, 0.3, 0.0]]), 1),
        (square(1.0), square(1.0, centre=(5.0, 0.0)), 0),
    ],
)
def test_touching_set(first, second, count):
    """Extreme points of two overlapping features, in either order."""
    one, other = touching_set(first, second, UP), touching_set(second, first, UP)
    assert len(one) == len(other) == count
    if count:
        np.testing.assert_allclose(np.sort(one.round(9), axis=0), np.sort(other.round(9), axis=0), atol=1e-9)


@pytest.mark.parametrize(("tilt", "touching"), [(1e-10, [0, 1, 2, 3]), (1e-7, [0, 3])])
def test_corners_of_a_tilted_face_in_contact(tilt, touching):
    """Faces are parallel up to 1e-6 rad, corners in contact up to 1e-9 m; each point is midway at its own height."""
    first, second = square(1.0), square(0.5)
    second[:, 2] = tilt * (0.5 + second[:, 0])
    found = touching_set(first, second, UP)
    wanted = second[touching] * [1.0, 1.0, 0.5]
    assert len(found) == len(wanted)
    for point in wanted:
        assert np.abs(found - point).max(axis=1).min() < 1e-15


@pytest.mark.long
@pytest.mark.parametrize("radius", [1e-3, 0.02, 0.15, 1.0])
def test_gap_of_a_sphere_near_faces_edges_and_corners_of_a_box(tmp_path, rng, radius):
    """The search against the closed form (the centre clipped to the box), at gaps of 0 to 1e-7 m, after any evaluation.

    An error d of the direction costs extent * d at a face: the tolerance of 1e-14 m, forty times the rounding of coordinates
    of 1 m, allows 1e-14 rad. Near an edge the normals of face and edge differ by the drawn angle, down to 1e-12 rad.
    """
    half = np.full(3, 0.5)
    prepared = prepare(
        scene(
            tmp_path,
            ball("ball", radius=radius),
            {"block": box("block", half=tuple(half))},
            initial={"joints": {"block/free": [5.0, 0, 0, 1, 0, 0, 0]}},
            contacts={"rules": [{"between": ["ball", "block/block"]}]},
        )
    )
    (pair,), model = prepared.assemble().pairs, prepared.system.mj
    pair._search = NormalSearch(pair.ids, pair.size)  # of a sphere nothing is searched otherwise
    data = mujoco.MjData(model)
    for _ in range(100):
        across = rng.permutation(3)[: rng.integers(1, 4)]
        point, outward = rng.uniform(-0.5, 0.5, 3), np.zeros(3)
        point[across] = np.copysign(half[across], point[across])
        outward[across] = np.copysign(10.0 ** rng.uniform(-12, 0, len(across)), point[across])
        outward /= np.linalg.norm(outward)
        centre = point + (radius + rng.choice([0.0, 1e-12, 1e-9, 1e-7])) * outward
        quaternion = rng.normal(size=4)
        quaternion /= np.linalg.norm(quaternion)
        rotation = np.empty(9)
        mujoco.mju_quat2Mat(rotation, quaternion)
        rotation = rotation.reshape(3, 3)
        data.qpos[:] = [0, 0, 0, 1, 0, 0, 0, *(-rotation @ centre), *quaternion]
        mujoco.mj_forward(model, data)
        seen = rotation @ -outward + rng.choice([0.0, 1e-6, 0.3]) * rng.normal(size=3)
        pair._search._last = seen / np.linalg.norm(seen)
        centre = rotation.T @ (data.geom_xpos[0] - data.geom_xpos[1])
        true = np.linalg.norm(centre - np.clip(centre, -half, half)) - radius
        assert pair.proximity(model, data).gap == pytest.approx(true, abs=1e-14)


@pytest.mark.parametrize("swapped", [False, True])
@pytest.mark.parametrize("name", ["sphere", "capsule", "cylinder", "box"])
def test_normal_of_a_sphere_is_the_direction_of_largest_separation(rng, name, swapped):
    """Support functions say so, which know nothing of nearest points: apart, in contact and with the centre within.

    No direction separates bodies by more than their distance, so one that does by as much is the normal. Of bodies that
    overlap no direction may do so by more. Coordinates of 1 m round to 1e-15 m.
    """
    geoms = [f"<geom {SHAPES[name]}/>", '<geom type="sphere" size="0.05"/>']
    bodies = "".join(f"<body><freejoint/>{geom}</body>" for geom in (geoms[::-1] if swapped else geoms))
    model = mujoco.MjModel.from_xml_string(f"<mujoco><worldbody>{bodies}</worldbody></mujoco>")
    data, search = mujoco.MjData(model), SphereNormal((0, 1), 0.05)
    for k in range(200):
        data.qpos[:] = rng.normal(size=14)
        data.qpos[[0, 1, 2]] *= 0.0 if k % 10 else 0.01
        # Every third coordinate is that of the centre of the other: nearest to an axis, to the middle of a face.
        data.qpos[7:10] = data.qpos[:3] + 0.2 * rng.normal(size=3) * rng.integers(0, 3, 3)
        mujoco.mj_forward(model, data)
        shapes = Shape(model, data, 0), Shape(model, data, 1)
        normal, points, _, gap = search.normal(model, data, shapes)
        assert np.linalg.norm(normal) == pytest.approx(1.0, abs=1e-15)
        assert separation(*shapes, normal) == pytest.approx(gap, abs=2e-15)
        assert (points[1] - points[0])[0] == pytest.approx(gap * normal, abs=2e-15)
        directions = np.vstack((normal + 0.1 * rng.normal(size=(20, 3)), rng.normal(size=(20, 3))))
        directions /= np.linalg.norm(directions, axis=1)[:, None]
        assert max(separation(*shapes, direction) for direction in directions) <= gap + 1e-15


def test_a_corner_near_the_centre_of_a_cap(rng):
    """From 1e-9 to 1e-6 rad off the axis the rim has radii of 1e5 to 1e8 m: the other radius is rounding, zero at times."""
    model = mujoco.MjModel.from_xml_string(
        f"""<mujoco><worldbody><geom type="box" size="0.1 0.15 0.2"/><body><freejoint/>
        <geom {SHAPES["cylinder"]}/></body></worldbody></mujoco>"""
    )
    data = mujoco.MjData(model)
    for _ in range(100):
        turn = rng.normal(size=3)
        data.qpos[3:] = rng.normal(size=4)
        mujoco.mj_forward(model, data)
        axis, tilt = data.geom_xmat[1].reshape(3, 3)[:, 2], 10 ** rng.uniform(-9, -6)
        estimate = axis + tilt * np.cross(axis, turn / np.linalg.norm(turn))
        estimate /= np.linalg.norm(estimate)
        corner = np.sign(estimate) * (0.1, 0.15, 0.2)
        data.qpos[:3] = corner + 0.15 * axis + rng.normal(size=3) * (2e-2, 2e-2, 2e-2)
        data.qpos[:3] -= ((data.qpos[:3] - corner) @ axis - 0.15) * axis  # a gap of 0: any offset across the axis
        mujoco.mj_forward(model, data)
        normal = refine_normal(Shape(model, data, 0), Shape(model, data, 1), estimate)
        np.testing.assert_allclose(normal, axis, atol=1e-14)


@pytest.mark.parametrize("beyond_m", [-5e-6, 5e-6])
def test_a_ball_just_beyond_an_edge_is_not_on_the_face(beyond_m):
    """The face is tried first; beyond the edge the normal is tilted by 3e-5 rad, from an estimate tilted the other way.

    The separation at the normal falls by 0.15 m d^2 / 2 for an error d of the direction, and Newton's method finds its zero
    slope, known to 1e-16 m / 0.15 m.
    """
    model = mujoco.MjModel.from_xml_string(f"""<mujoco>{HEAD}<worldbody><geom type="box" size="0.5 0.5 0.5"/>
      <body><freejoint/><geom type="sphere" size="0.15" mass="1"/></body></worldbody></mujoco>""")
    data = mujoco.MjData(model)
    tilt = max(beyond_m, 0.0) / 0.15
    data.qpos[:3] = 0.5 + beyond_m, 0.1, 0.5 + 0.15 * np.sqrt(1.0 - tilt**2)
    mujoco.mj_forward(model, data)
    estimate = np.array((-3e-5, 0.0, 1.0))
    found = refine_normal(Shape(model, data, 0), Shape(model, data, 1), estimate / np.linalg.norm(estimate))
    np.testing.assert_allclose(found, (tilt, 0.0, np.sqrt(1.0 - tilt**2)), rtol=0, atol=1e-14)


@pytest.mark.long
def test_the_normal_at_the_border_of_a_small_facet_does_not_depend_on_the_estimate(rng):
    """A ball 1e-9 m inside the border of a facet of a fine mesh: the normal is that of the facet, from any estimate.

    That of the border is as good to rounding, 1e-9 m / 0.1 m off: forces in persistent contact would differ as much between
    a run and the replay of its log, which begins with another estimate.
    """
    radius, vertices = 0.1, rng.normal(size=(1500, 3))
    vertices *= 0.2 / np.linalg.norm(vertices, axis=1)[:, None]
    mesh = " ".join(f"{x:.6f}" for x in vertices.ravel())
    model = mujoco.MjModel.from_xml_string(f"""<mujoco><asset><mesh name="dome" vertex="{mesh}"/></asset><worldbody>
      <geom type="mesh" mesh="dome"/><geom type="sphere" size="{radius}"/></worldbody></mujoco>""")
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    turn = data.geom_xmat[0].reshape(3, 3)
    for polygon in rng.integers(model.mesh_polynum[0], size=20):
        start = model.mesh_polyvertadr[polygon]
        a, b, c = model.mesh_vert[model.mesh_polyvert[start : start + 3]].astype(float) @ turn.T + data.geom_xpos[0]
        normal = np.cross(b - a, c - a)
        normal /= np.linalg.norm(normal)
        inwards = np.cross(normal, b - a)
        data.geom_xpos[1] = 0.5 * (a + b) + radius * normal + 1e-9 * inwards / np.linalg.norm(inwards)
        shapes = Shape(model, data, 0), Shape(model, data, 1)
        for _ in range(5):
            estimate = normal + 1e-5 * rng.normal(size=3)
            found = refine_normal(*shapes, estimate / np.linalg.norm(estimate))
            # A facet of 1e-2 m and corners at 0.2 m rounded to 1e-16 m: its normal is known to 1e-13 rad.
            np.testing.assert_allclose(found, normal, rtol=0, atol=1e-12)


@pytest.mark.parametrize("name", SHAPES)
def test_extents_are_those_of_extreme_points(name, rng):
    """Along many directions at once."""
    model = mujoco.MjModel.from_xml_string(shape(name))
    data = mujoco.MjData(model)
    data.qpos[:] = rng.normal(size=7)
    mujoco.mj_kinematics(model, data)
    one, directions = Shape(model, data, 0), rng.normal(size=(20, 3))
    directions /= np.linalg.norm(directions, axis=1)[:, None]
    expected = [support(name, model, data, 0, direction) for direction in directions]
    np.testing.assert_allclose(one.extents(directions), expected, atol=1e-14)
